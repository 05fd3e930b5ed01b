# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate pose-graph optimisation on published graphs, and with wrong loop closures.

The objective is the sum of ``e' Omega e``; e is the SE(2) or SE(3) logarithm of the error of an edge. Wrong
loop closures, a tenth of the number of correct ones, are added between random poses of smallGrid3D,
sphere2500 and intel. The results are the numbers of wrong closures accepted and of correct closures rejected.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.formats.pose_graph import read_pose_graph
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_common.types import PoseGraph
from cdff_common.types.pose_graph_ext import LOOP_CLOSURE
from cdff_core.dfns.pose_graph_optimization.interface import PoseGraphOptimizationInputs

#: Published optima of the same objective (GTSAM, best of several initial values).
OPTIMA = {
    "sphere2500": 1351.402,
    "parking-garage": 1.2684,
    "intel": 45.0042,
    "smallGrid3D": 1035.851,
    "kitti_05": 157.1038,
}
ROBUST_GRAPHS = ("smallGrid3D", "intel", "sphere2500")
WRONG_RATIO, SEEDS = 0.1, range(5)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the optimum of each graph, and the results with wrong loop closures."""
    report: dict[str, Any] = {"optima": {}, "false_loops": {}}
    for name, published in OPTIMA.items():
        progress(f"pose graphs: {name}")
        graph = read_pose_graph(data / "posegraphs" / f"{name}.g2o", frame="map")
        solution, cpu_s = optimise(graph)
        report["optima"][name] = {
            "poses": len(graph.vertices.ids),
            "edges": len(graph.edges.ends),
            "published": published,
            "chi2_initial": solution["chi2_initial"],
            "chi2_final": solution["chi2_final"],
            "excess_percent": round(100.0 * (solution["chi2_final"] / published - 1.0), 4),
            "iterations": solution["iterations"],
            "reasons": solution["reasons"],
            "cpu_s": round(cpu_s, 2),
        }
    for name in ROBUST_GRAPHS:
        progress(f"pose graphs: {name} with wrong loops")
        graph = read_pose_graph(data / "posegraphs" / f"{name}.g2o", frame="map")
        report["false_loops"][name] = with_wrong_loops(graph)
    return report


def optimise(graph: PoseGraph, **config: Any) -> tuple[dict[str, Any], float]:
    """Optimise a graph; return metrics, iterations, reasons and weights, and CPU seconds."""
    node = Registry.default().make_dfn("pose_graph_optimization")
    node.configure(config)
    started = time.process_time()
    outputs = node.process(PoseGraphOptimizationInputs(graph=graph))
    cpu_s = time.process_time() - started
    results = {**node.metrics, "iterations": outputs.iterations, "reasons": list(node.reasons)}
    return results | {"weights": outputs.weights}, cpu_s


def wrong_loops(graph: PoseGraph, seed: int) -> tuple[PoseGraph, int]:
    """Return the graph with wrong loop closures as its last edges, and their number."""
    vertices, edges = graph.vertices, graph.edges
    count = max(1, round(WRONG_RATIO * int(np.count_nonzero(edges.kinds == LOOP_CLOSURE))))
    rng = np.random.default_rng(seed)
    n = len(vertices.ids)
    first = rng.integers(0, n, count)
    second = (first + rng.integers(2, n - 1, count)) % n
    is_plane = not np.any(vertices.poses[:, 2:5])
    twist = rng.normal(size=(count, 6)) * [2.0, 2.0, 2.0, 1.0, 1.0, 1.0]
    twist[:, 2:5] *= 0.0 if is_plane else 1.0
    mixed = PoseGraph.from_arrays(
        vertices.ids,
        vertices.stamps_ns,
        vertices.matrices,
        np.vstack([edges.ends, np.column_stack([vertices.ids[first], vertices.ids[second]])]),
        np.concatenate([edges.matrices, se3.exp_se3(twist)]),
        np.concatenate([edges.information_matrices, edges.information_matrices[:count]]),
        np.concatenate([edges.kinds, np.full(count, LOOP_CLOSURE)]),
        frame=graph.frame,
    )
    return mixed, count


def with_wrong_loops(graph: PoseGraph) -> dict[str, Any]:
    """Return the numbers of wrong loop closures accepted and correct ones rejected, over all seeds."""
    correct_loops = int(np.count_nonzero(graph.edges.kinds == LOOP_CLOSURE))
    accepted = rejected = 0
    for seed in SEEDS:
        mixed, count = wrong_loops(graph, seed)
        weights = optimise(mixed, robust="gnc")[0]["weights"]
        accepted += int(np.count_nonzero(weights[-count:]))
        rejected += int(np.count_nonzero(weights[:-count] == 0.0))
    trials = len(SEEDS)
    return {
        "seeds": trials,
        "false_loops": trials * count,
        "false_loops_accepted": accepted,
        "true_loops": trials * correct_loops,
        "true_loops_rejected": rejected,
    }

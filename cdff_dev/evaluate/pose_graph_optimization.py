# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose-graph optimisation on published graphs: the optimum from the file's poses, from odometry, and with wrong loops.

The objective is that of the contract: the sum of ``e' Omega e``, e the SE(2) or SE(3) logarithm of an edge's error.
With wrong loops: as many as a tenth of the right ones are put between random poses of smallGrid3D, sphere2500 and
intel; counted are those that were kept, and right ones that were lost.
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
from cdff_core.dfns.pose_graph_optimization._interface import PoseGraphOptimizationInputs

#: Published optima of the same objective (GTSAM from the best of its starts).
OPTIMA = {
    "sphere2500": 1351.402,
    "parking-garage": 1.2684,
    "intel": 45.0042,
    "smallGrid3D": 1035.851,
    "kitti_05": 157.1038,
}
WITH_LIES = ("smallGrid3D", "intel", "sphere2500")
LIES, SEEDS = 0.1, range(5)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Figures of each graph."""
    report: dict[str, Any] = {"optima": {}, "wrong_loops": {}}
    for name, published in OPTIMA.items():
        progress(f"pose graphs: {name}")
        graph = read_pose_graph(data / "posegraphs" / f"{name}.g2o", frame="map")
        found, cpu_s = solved(graph)
        report["optima"][name] = {
            "poses": len(graph.vertices.ids), "edges": len(graph.edges.ends), "published": published,
            "chi2_initial": found["chi2_initial"], "chi2_final": found["chi2_final"],
            "excess_percent": round(100.0 * (found["chi2_final"] / published - 1.0), 4),
            "iterations": found["iterations"], "reasons": found["reasons"], "cpu_s": round(cpu_s, 2),
        }  # fmt: skip
    for name in WITH_LIES:
        progress(f"pose graphs: {name} with wrong loops")
        graph = read_pose_graph(data / "posegraphs" / f"{name}.g2o", frame="map")
        report["wrong_loops"][name] = with_lies(graph)
    return report


def solved(graph: PoseGraph, **config: Any) -> tuple[dict[str, Any], float]:
    """What optimisation says of a graph, and its CPU seconds."""
    node = Registry.default().make_dfn("pose_graph_optimization")
    node.configure(config)
    began = time.process_time()
    out = node.process(PoseGraphOptimizationInputs(graph))
    spent = time.process_time() - began
    found = {**node.metrics, "iterations": int(out.iterations), "reasons": list(node.reasons)}
    return found | {"weights": out.weights}, spent


def with_lies(graph: PoseGraph) -> dict[str, Any]:
    """Wrong loops kept and right ones lost, over seeds."""
    edges = graph.edges
    right = int(np.count_nonzero(edges.kinds == LOOP_CLOSURE))
    count = max(1, round(LIES * right))
    kept = lost = 0
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        n = len(graph.vertices.ids)
        a = rng.integers(0, n, count)
        b = (a + rng.integers(2, n - 1, count)) % n
        is_plane = not np.any(graph.vertices.poses[:, 2:5])
        twist = rng.normal(size=(count, 6)) * [2.0, 2.0, 2.0, 1.0, 1.0, 1.0]
        twist[:, 2:5] *= 0.0 if is_plane else 1.0
        lies = PoseGraph.from_arrays(
            graph.vertices.ids, graph.vertices.stamps_ns, graph.vertices.matrices,
            np.vstack([edges.ends, np.column_stack([graph.vertices.ids[a], graph.vertices.ids[b]])]),
            np.concatenate([edges.matrices, se3.exp_se3(twist)]),
            np.concatenate([edges.information_matrices, edges.information_matrices[:count]]),
            np.concatenate([edges.kinds, np.full(count, LOOP_CLOSURE)]), frame=graph.frame,
        )  # fmt: skip
        weights = solved(lies, robust="gnc")[0]["weights"]
        kept += int(np.count_nonzero(weights[-count:]))
        lost += int(np.count_nonzero(weights[:-count] == 0.0))
    trials = len(SEEDS)
    return {
        "seeds": trials, "wrong_loops": trials * count, "wrong_loops_kept": kept,
        "right_loops": trials * right, "right_loops_lost": lost,
    }  # fmt: skip

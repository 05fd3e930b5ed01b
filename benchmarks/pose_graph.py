# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose-graph optimisation beside GTSAM on published graphs, both judged by our objective; CPU seconds.

OMP_NUM_THREADS=1 python benchmarks/pose_graph.py [--data DIR] [--trials N] [--out FILE]

GTSAM runs Levenberg-Marquardt from the poses of the file (from odometry where there are none) with the first pose held,
and, for spatial graphs, from its own chordal initialisation. Graph building is left out of its times, ours are of the
whole DFN. Trials alternate; the least CPU time counts.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
import tracemalloc
from pathlib import Path
from typing import Any

import gtsam
import numpy as np
from _report import give_out

from cdff_common.formats.g2o import read_g2o
from cdff_common.formats.pose_graph import read_pose_graph
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import swap_rotation_translation
from cdff_common.interfaces.registry import Registry
from cdff_common.types import PoseGraph
from cdff_core.dfns.pose_graph_optimization._interface import PoseGraphOptimizationInputs
from cdff_core.dfns.pose_graph_optimization._problem import problem_of

ROOT = Path(__file__).resolve().parents[1]
GRAPHS = ("sphere2500", "parking-garage", "intel", "smallGrid3D", "kitti_05")


def ours(graph: PoseGraph) -> tuple[np.ndarray, float]:
    node = Registry.default().make_dfn("pose_graph_optimization")
    node.configure()
    began = time.process_time()
    out = node.process(PoseGraphOptimizationInputs(graph))
    return out.graph.vertices.matrices, time.process_time() - began


def theirs(graph: PoseGraph, path: Path, *, chordal: bool) -> tuple[np.ndarray, float]:
    """Poses of GTSAM in the order of the graph's vertices."""
    g = read_g2o(path)
    factors = gtsam.NonlinearFactorGraph()
    order = swap_rotation_translation(g.information)
    for (a, b), T, information in zip(g.ends.tolist(), g.measured_matrices, order, strict=True):
        noise = gtsam.noiseModel.Gaussian.Information(information + 1e-9 * np.eye(6))
        factors.add(gtsam.BetweenFactorPose3(a, b, gtsam.Pose3(T), noise))
    ids = graph.vertices.ids.tolist()
    first = gtsam.Pose3(graph.vertices.matrices[0])
    factors.add(gtsam.PriorFactorPose3(ids[0], first, gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)))
    values = gtsam.Values()
    for i, T in zip(ids, graph.vertices.matrices, strict=True):
        values.insert(i, gtsam.Pose3(T))
    began = time.process_time()
    if chordal:
        values = gtsam.InitializePose3.initialize(factors)
    found = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    spent = time.process_time() - began
    return np.array([found.atPose3(i).matrix() for i in ids]), spent


def chi2(graph: PoseGraph, poses: np.ndarray) -> float:
    problem = problem_of(graph)
    rigid = se3.transform(se3.normalise_rotation(poses[:, :3, :3]), poses[:, :3, 3])
    return float(problem.squared(problem.errors(rigid)).sum())


def compared(path: Path, trials: int) -> dict[str, Any]:
    graph = read_pose_graph(path, frame="map")
    spatial = bool(np.any(graph.vertices.poses[:, 2:5]))
    runs: dict[str, Any] = {"ours": lambda: ours(graph)}
    if spatial:
        # GTSAM has other factors for the plane: only the same problem is compared.
        runs["gtsam, given poses"] = lambda: theirs(graph, path, chordal=False)
        runs["gtsam, chordal"] = lambda: theirs(graph, path, chordal=True)
    found: dict[str, dict[str, Any]] = {}
    for _ in range(trials):
        for name, run in runs.items():
            try:
                poses, cpu_s = run()
            except RuntimeError as error:
                found[name] = {"failed": str(error).splitlines()[0][:200]}
                continue
            entry = found.setdefault(name, {"chi2": round(chi2(graph, poses), 4), "cpu_s": cpu_s})
            entry["cpu_s"] = round(min(entry["cpu_s"], cpu_s), 4)
    tracemalloc.start()
    ours(graph)
    found["ours"]["memory_mb"] = round(tracemalloc.get_traced_memory()[1] / 1e6, 1)
    tracemalloc.stop()
    return {"poses": len(graph.vertices.ids), "edges": len(graph.edges.ends), **found}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("CDFF_DATA") or ROOT.parent / "shared/data"))
    parser.add_argument("--trials", type=int, default=3)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    report = {name: compared(args.data / "posegraphs" / f"{name}.g2o", args.trials) for name in GRAPHS}
    give_out({"benchmark": "pose_graph", "machine": platform.machine(), **report}, args.out)


if __name__ == "__main__":
    main()

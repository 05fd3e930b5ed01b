# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare pose-graph optimisation with GTSAM on published graphs with the same objective; CPU seconds.

OMP_NUM_THREADS=1 python benchmarks/pose_graph.py [--data DIR] [--trials N] [--seeds N] [--out FILE]

GTSAM runs Levenberg-Marquardt from the poses of the file (or from odometry if the file has none) with the
first pose fixed, and for spatial graphs also from its own chordal initialisation. Its times exclude graph
building, those of CDFF are of the whole DFN. Trials alternate; the minimum CPU time is reported.

``covariance``: the marginal covariance of the last pose, after the optimisation. ``wrong_loops``: the graphs
of the evaluation with wrong loop closures, solved by graduated non-convexity: ``robust=gnc``, and
``gtsam.GncLMOptimizer`` with odometry as known inliers, the same threshold, and the chordal poses of CDFF as
initial values.
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
from _report import write_report
from scipy.stats import chi2 as chi_squared

from cdff_common.formats.pose_graph import read_pose_graph
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import rotate_covariance, swap_rotation_translation
from cdff_common.interfaces.registry import Registry
from cdff_common.types import PoseGraph
from cdff_core.dfns.pose_graph_optimization._chordal import chordal_poses
from cdff_core.dfns.pose_graph_optimization._problem import make_problem
from cdff_core.dfns.pose_graph_optimization.chordal_gauss_newton import ChordalGaussNewtonConfig
from cdff_core.dfns.pose_graph_optimization.interface import (
    PoseGraphOptimizationInputs,
    PoseGraphOptimizationOutputs,
)
from evaluation.pose_graph_optimization import wrong_loops

ROOT = Path(__file__).resolve().parents[1]
GRAPHS = ("sphere2500", "parking-garage", "intel", "smallGrid3D", "kitti_05")
#: Spatial graphs to which wrong loop closures are added.
ROBUST_GRAPHS = ("smallGrid3D", "sphere2500")
FIXED_SIGMA = 1e-6


def solve_with_cdff(
    graph: PoseGraph, covariance_ids: np.ndarray | None = None, **config: Any
) -> tuple[PoseGraphOptimizationOutputs, float]:
    """Return the outputs of the DFN, and CPU seconds; covariances of the poses ``covariance_ids``."""
    node = Registry.default().make_dfn("pose_graph_optimization")
    node.configure(config)
    start_s = time.process_time()
    outputs = node.process(PoseGraphOptimizationInputs(graph=graph, wanted=covariance_ids))
    return outputs, time.process_time() - start_s


def gtsam_factors(graph: PoseGraph) -> gtsam.NonlinearFactorGraph:
    """Return the prior of the first pose, then the edges in their order; keys are rows of vertices."""
    problem, factors = make_problem(graph), gtsam.NonlinearFactorGraph()
    fixed_noise = gtsam.noiseModel.Isotropic.Sigma(6, FIXED_SIGMA)
    row = int(problem.fixed[0])
    factors.add(gtsam.PriorFactorPose3(row, gtsam.Pose3(graph.vertices.matrices[row]), fixed_noise))
    information = swap_rotation_translation(problem.information) + 1e-9 * np.eye(6)
    for a, b, T, edge in zip(problem.vertex_a, problem.vertex_b, problem.measured, information, strict=True):
        noise = gtsam.noiseModel.Gaussian.Information(edge)
        factors.add(gtsam.BetweenFactorPose3(int(a), int(b), gtsam.Pose3(T), noise))
    return factors


def gtsam_values(poses: np.ndarray) -> gtsam.Values:
    """Return poses as GTSAM's values; keys are rows."""
    values = gtsam.Values()
    for row, T in enumerate(poses):
        values.insert(row, gtsam.Pose3(T))
    return values


def solve_with_gtsam(graph: PoseGraph, *, is_chordal: bool) -> tuple[np.ndarray, float]:
    """Return the optimal poses, and CPU seconds."""
    factors, values = gtsam_factors(graph), gtsam_values(graph.vertices.matrices)
    start_s = time.process_time()
    if is_chordal:
        values = gtsam.InitializePose3.initialize(factors)
    result = gtsam.LevenbergMarquardtOptimizer(factors, values).optimize()
    cpu_s = time.process_time() - start_s
    return _poses(result, len(graph.vertices.ids)), cpu_s


def _poses(values: gtsam.Values, count: int) -> np.ndarray:
    return np.array([values.atPose3(row).matrix() for row in range(count)])


def chi2(graph: PoseGraph, poses: np.ndarray) -> float:
    """Return the objective of poses: the sum of the squared normalised errors of all edges."""
    problem = make_problem(graph)
    rigid = se3.transform(se3.normalise_rotation(poses[:, :3, :3]), poses[:, :3, 3])
    return float(problem.squared_errors(rigid).sum())


def covariances(graph: PoseGraph, trials: int) -> dict[str, Any]:
    """Return CPU seconds of one marginal covariance at the optimum, and the largest relative difference."""
    optimum = solve_with_cdff(graph)[0].graph
    last = len(optimum.vertices.ids) - 1
    factors, values = gtsam_factors(optimum), gtsam_values(optimum.vertices.matrices)
    times: dict[str, list[float]] = {"cdff": [], "gtsam": []}
    for _ in range(trials):
        without_s = solve_with_cdff(optimum, initialise="given")[1]
        outputs, with_s = solve_with_cdff(optimum, optimum.vertices.ids[[last]], initialise="given")
        times["cdff"].append(with_s - without_s)
        start_s = time.process_time()
        peer = gtsam.Marginals(factors, values).marginalCovariance(last)
        times["gtsam"].append(time.process_time() - start_s)
    expected = rotate_covariance(swap_rotation_translation(peer), optimum.vertices.matrices[last][:3, :3])
    difference = np.abs(outputs.covariances[0] - expected).max() / np.abs(expected).max()
    return {method: {"cpu_s": round(min(s), 4)} for method, s in times.items()} | {
        "relative_difference": float(f"{difference:.2g}")
    }


def robust(graph: PoseGraph, seeds: int) -> dict[str, Any]:
    """Return the numbers of wrong loop closures accepted and correct ones rejected, and CPU seconds per
    graph.
    """
    counts: dict[str, dict[str, Any]] = {
        m: {"wrong_accepted": 0, "correct_rejected": 0, "cpu_s": 0.0} for m in ("cdff", "gtsam")
    }
    for seed in range(seeds):
        mixed, count = wrong_loops(graph, seed)
        outputs, cpu_s = solve_with_cdff(mixed, robust="gnc")
        weights = {"cdff": (outputs.weights, cpu_s), "gtsam": gtsam_gnc(mixed)}
        for method, (weight, cpu_s) in weights.items():
            row = counts[method]
            row["wrong_accepted"] += int(np.count_nonzero(weight[-count:] > 0.5))
            row["correct_rejected"] += int(np.count_nonzero(weight[:-count] <= 0.5))
            row["cpu_s"] = round(row["cpu_s"] + cpu_s / seeds, 4)
    return {"seeds": seeds, "wrong_loops": seeds * count, **counts}


def gtsam_gnc(graph: PoseGraph) -> tuple[np.ndarray, float]:
    """Return the weights of the edges by GTSAM's graduated non-convexity, and CPU seconds."""
    problem, factors = make_problem(graph), gtsam_factors(graph)
    odometry = np.where(problem.is_loop, 0.0, 1.0)
    values = gtsam_values(chordal_poses(problem, graph.vertices.matrices, odometry))
    parameters = gtsam.GncLMParams()
    parameters.setKnownInliers([0, *(np.flatnonzero(~problem.is_loop) + 1).tolist()])
    start_s = time.process_time()
    optimizer = gtsam.GncLMOptimizer(factors, values, parameters)
    # GTSAM compares half the squared residual with the threshold.
    probability = ChordalGaussNewtonConfig().inlier_probability
    optimizer.setInlierCostThresholds(0.5 * chi_squared.ppf(probability, 6))
    optimizer.optimize()
    return np.asarray(optimizer.getWeights())[1:], time.process_time() - start_s


def compare_solvers(path: Path, trials: int, seeds: int) -> dict[str, Any]:
    """Return the results of all solvers on one graph."""
    graph = read_pose_graph(path, frame="map")
    is_spatial = len(make_problem(graph).rows) == 6
    runs: dict[str, Any] = {"cdff": lambda: _solved(graph)}
    if is_spatial:
        # GTSAM has different factors for planar graphs; only spatial graphs are the same problem.
        runs["gtsam, given poses"] = lambda: solve_with_gtsam(graph, is_chordal=False)
        runs["gtsam, chordal"] = lambda: solve_with_gtsam(graph, is_chordal=True)
    report: dict[str, Any] = {"poses": len(graph.vertices.ids), "edges": len(graph.edges.ends)}
    for _ in range(trials):
        for name, run in runs.items():
            try:
                poses, cpu_s = run()
            except RuntimeError as error:
                report[name] = {"failed": str(error).splitlines()[0][:200]}
                continue
            entry = report.setdefault(name, {"chi2": round(chi2(graph, poses), 4), "cpu_s": cpu_s})
            entry["cpu_s"] = round(min(entry["cpu_s"], cpu_s), 4)
    tracemalloc.start()
    solve_with_cdff(graph)
    report["cdff"]["memory_mb"] = round(tracemalloc.get_traced_memory()[1] / 1e6, 1)
    tracemalloc.stop()
    if is_spatial:
        report["covariance"] = covariances(graph, trials)
    if path.stem in ROBUST_GRAPHS and seeds:
        report["wrong_loops"] = robust(graph, seeds)
    return report


def _solved(graph: PoseGraph) -> tuple[np.ndarray, float]:
    outputs, cpu_s = solve_with_cdff(graph)
    return outputs.graph.vertices.matrices, cpu_s


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--data", type=Path, default=Path(os.environ.get("CDFF_DATA") or ROOT.parent / "shared/data")
    )
    parser.add_argument("--trials", type=int, default=3)
    parser.add_argument("--seeds", type=int, default=5, help="number of graphs with wrong loop closures")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    report = {
        name: compare_solvers(args.data / "posegraphs" / f"{name}.g2o", args.trials, args.seeds)
        for name in GRAPHS
    }
    write_report({"benchmark": "pose_graph", "machine": platform.machine(), **report}, args.out)


if __name__ == "__main__":
    main()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare point_cloud_matching and its solver with KISS-Matcher; measure the cost of the DFNs.

OMP_NUM_THREADS=1 python benchmarks/point_cloud_matching.py [--data DIR] [--trials N] [--solver-trials N]
    [--peer-python PYTHON] [--out FILE]

Clouds and limits are those of evaluation/point_cloud_matching.py; its results over all trials are in
docs/evaluation. KISS-Matcher runs in a separate environment (``--peer-python``, with kiss-matcher and numpy
installed). SHOT and FPFH: ``python -m evaluation shot_localisation``.

``solver``: GlobalRegistration3D, and KISS-Matcher's pruning and solver with noise bounds of 3 cm, on the same
1000 pairs in a cube of 2 m with noise up to 3 cm, for two ratios of wrong pairs.
"""

from __future__ import annotations

import argparse
import os
import platform
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from _report import measure, write_report

from cdff_common.geometry.voxels import voxel_for, voxel_means
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.features_description_3d.interface import FeaturesDescription3DInputs
from cdff_core.dfns.features_extraction_3d.interface import FeaturesExtraction3DInputs
from cdff_core.dfns.features_matching_3d.interface import FeaturesMatching3DInputs
from cdff_core.dfns.global_registration_3d.interface import GlobalRegistration3DInputs
from cdff_core.dfns.normals_estimation.interface import NormalsEstimationInputs
from evaluation import point_cloud_matching as evaluation
from evaluation.data_sets.clouds import small_gicp_pair
from evaluation.peers import colmap

WRONG_RATIOS = (0.9, 0.98)
_KISS_SOLVER = """
import sys, time, numpy as np, kiss_matcher
z = np.load(sys.argv[1])
config = kiss_matcher.KISSMatcherConfig(voxel_size=0.03, solver_noise_bound_gain=1.0)
matcher, T, cpu = kiss_matcher.KISSMatcher(config), [], []
for source, target in zip(z["sources"], z["targets"]):
    source, target = list(source.astype(np.float32)), list(target.astype(np.float32))
    started = time.process_time()
    solution = matcher.prune_and_solve(source, target)
    cpu.append(time.process_time() - started)
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = solution.rotation, solution.translation
    T.append(M if solution.valid else np.full((4, 4), np.nan))
    matcher.clear()
np.savez(sys.argv[2], T=T, cpu=cpu)
"""


def solver_results(trials: int, python: str | None) -> dict[str, Any]:
    """Return the numbers of correct and wrong answers of both solvers, and their median CPU seconds."""
    report: dict[str, Any] = {}
    for ratio in WRONG_RATIOS:
        result = evaluation.solver_recall(trials, wrong=ratio)
        rows = {"cdff": {"correct": result["correct"]["count"], "cpu_s": result["cpu_s"]["median"]}}
        if python:
            sources, targets, truth = zip(
                *(evaluation.solver_pairs(seed, 1000, ratio) for seed in range(trials)), strict=True
            )
            inputs = {"sources": np.array(sources), "targets": np.array(targets)}
            peer = colmap.run(python, _KISS_SOLVER, inputs)
            answers = [
                (T, T_true) for T, T_true in zip(peer["T"], truth, strict=True) if np.isfinite(T).all()
            ]
            errors = [evaluation.pose_errors(T, T_true) for T, T_true in answers]
            correct = sum(m <= 0.05 and deg <= evaluation.GATE_DEG for m, deg in errors)
            rows["kiss_matcher"] = {
                "correct": correct,
                "wrong": len(answers) - correct,
                "cpu_s": round(float(np.median(peer["cpu"])), 5),
            }
        report[f"{ratio:.0%} wrong pairs"] = {"trials": trials, **rows}
    return report


def run_terrain(trials: int) -> dict[str, Any]:
    """Return recall, false accepts and CPU time of the DFPC and of KISS-Matcher."""
    results: evaluation.Trials = {}
    for seed in range(trials):
        for name, methods in evaluation.run_seed(seed).items():
            for method, trial in methods.items():
                results.setdefault(name, {}).setdefault(method, []).append(trial)
    return evaluation.summarise_terrain(results)


def node(name: str, implementation: str | None = None, **config: Any) -> Any:
    """Return a configured DFN."""
    dfn = Registry.default().make_dfn(name, implementation)
    dfn.configure(config)
    return dfn


def dfn_costs(data: Path, rounds: int) -> dict[str, Any]:
    """Return CPU seconds and memory of each DFN, with the input sizes stated in their descriptions."""
    source, *_ = small_gicp_pair(data)
    voxel_m = voxel_for(source, 8000)
    points = voxel_means(source, voxel_m)
    normals = node("normals_estimation").process(NormalsEstimationInputs(points=points)).normals
    keypoints = (
        node("features_extraction_3d", max_keypoints=1000)
        .process(FeaturesExtraction3DInputs(points=points))
        .keypoints
    )
    rng = np.random.default_rng(0)
    descriptors = [rng.random((2000, 352), np.float32) for _ in range(2)]
    pairs = [rng.uniform(-1, 1, (1000, 3)) for _ in range(2)]
    pairs[1][:20] = pairs[0][:20]
    description_inputs = FeaturesDescription3DInputs(
        points=points, normals=normals, keypoints=keypoints, radius_m=10.0 * voxel_m
    )
    calls: dict[str, tuple[Any, Any]] = {
        "FeaturesExtraction3D/Uniform": (
            node("features_extraction_3d"),
            FeaturesExtraction3DInputs(points=points),
        ),
        "FeaturesExtraction3D/Harris": (
            node("features_extraction_3d", "Harris"),
            FeaturesExtraction3DInputs(points=points),
        ),
        "FeaturesExtraction3D/Iss": (
            node("features_extraction_3d", "Iss"),
            FeaturesExtraction3DInputs(points=points),
        ),
        "FeaturesDescription3D/Shot": (node("features_description_3d"), description_inputs),
        "FeaturesDescription3D/Fpfh": (node("features_description_3d", "Fpfh"), description_inputs),
        "FeaturesMatching3D/MutualRatio": (
            node("features_matching_3d"),
            FeaturesMatching3DInputs(source=descriptors[0], target=descriptors[1]),
        ),
        "GlobalRegistration3D/CliqueGnc": (
            node("global_registration_3d", noise_m=0.03),
            GlobalRegistration3DInputs(source=pairs[0], target=pairs[1]),
        ),
    }
    report: dict[str, Any] = {}
    for name, (dfn, inputs) in calls.items():
        report[name] = measure(partial(dfn.process, inputs), rounds)
    report["sizes"] = {"points": len(points), "keypoints": len(keypoints)}
    return report


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    default_data = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("CDFF_DATA") or default_data))
    parser.add_argument("--trials", type=int, default=5, help="trials per row")
    parser.add_argument("--solver-trials", type=int, default=500)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--peer-python", help="interpreter of an environment with kiss-matcher")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    if args.peer_python:
        os.environ["CDFF_PEER_PYTHON"] = args.peer_python
    report = {
        "benchmark": "point_cloud_matching",
        "python": platform.python_version(),
        "threads": os.environ.get("OMP_NUM_THREADS", "all"),
        "load_1min": os.getloadavg()[0],
        "solver": solver_results(args.solver_trials, args.peer_python),
        "dfns": dfn_costs(args.data, args.rounds),
    }
    if args.trials:
        report["simulated_terrain"] = run_terrain(args.trials)
    write_report(report, args.out)


if __name__ == "__main__":
    main()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure the cost of the image DFNs and DFPCs, and of COLMAP and GTSAM for comparison.

OMP_NUM_THREADS=1 python benchmarks/seeing.py [--data DIR] [--rounds N] [--peer-python PYTHON] [--out FILE]

The DFPCs are feature matching, triangulation and bundle adjustment. Input sizes are those of the
descriptions. CPU seconds are medians over the rounds, memory is the peak allocation of Python. Accuracy:
``python -m evaluation feature_matching triangulation bundle_adjustment``.
"""

from __future__ import annotations

import argparse
import os
import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from _report import measure, write_report

from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.bundle_optimization.interface import BundleOptimizationInputs
from cdff_core.dfns.cameras_transform_estimation.interface import CamerasTransformEstimationInputs
from cdff_core.dfns.essential_matrix_computation.interface import EssentialMatrixComputationInputs
from cdff_core.dfns.features_description_2d.interface import FeaturesDescription2DInputs
from cdff_core.dfns.features_extraction_2d.interface import FeaturesExtraction2DInputs
from cdff_core.dfns.features_matching_2d.interface import FeaturesMatching2DInputs
from cdff_core.dfns.fundamental_matrix_computation.interface import FundamentalMatrixComputationInputs
from cdff_core.dfns.homography_computation.interface import HomographyComputationInputs
from cdff_core.dfns.n_view_triangulation.interface import NViewTriangulationInputs
from cdff_core.dfns.transform_estimation_3d.interface import TransformEstimation3DInputs
from evaluation import feature_matching, feature_matching_models
from evaluation.data_sets.image_pairs import grey
from evaluation.peers import colmap
from evaluation.scenes.bundles import ring, solve_with_gtsam
from evaluation.triangulation import scene


def node(name: str, implementation: str | None = None, **config: Any) -> Any:
    """Return a configured DFN."""
    dfn = Registry.default().make_dfn(name, implementation)
    dfn.configure(config)
    return dfn


def dfn_costs(left: np.ndarray, rounds: int) -> dict[str, Any]:
    """Return the cost of each DFN with the input size of its description."""
    calls: dict[str, Callable[[], Any]] = {}
    for name in ("AdaptiveFast", "Sift", "Orb"):
        dfn = node("features_extraction_2d", name)
        calls[f"FeaturesExtraction2D/{name}"] = lambda dfn=dfn: dfn.process(
            FeaturesExtraction2DInputs(image=left)
        )
    points = (
        node("features_extraction_2d", "AdaptiveFast")
        .process(FeaturesExtraction2DInputs(image=left))
        .features[:2000]
    )
    for name in ("RootSift", "Sift", "Orb"):
        dfn = node("features_description_2d", name)
        calls[f"FeaturesDescription2D/{name}"] = lambda dfn=dfn: dfn.process(
            FeaturesDescription2DInputs(image=left, features=points)
        )
    rng = np.random.default_rng(0)
    left_descriptors, right_descriptors = (rng.integers(0, 256, (2000, 128), np.uint8) for _ in range(2))
    match = node("features_matching_2d")
    calls["FeaturesMatching2D/MutualRatio"] = lambda: match.process(
        FeaturesMatching2DInputs(source=left_descriptors, sink=right_descriptors)
    )
    views = feature_matching_models.two_views(0, 1000)
    source, sink, K = views["source"], views["sink"], views["K"]
    fundamental, essential = node("fundamental_matrix_computation"), node("essential_matrix_computation")
    homography = node("homography_computation", min_inliers=8, max_log10_false_alarms=0.0)
    plane = source @ np.array([[0.9, 0.1], [-0.1, 0.9]]) + rng.normal(0, 0.5, source.shape)
    decompose = node("cameras_transform_estimation")
    E = essential.process(
        EssentialMatrixComputationInputs(source=source, sink=sink, source_camera=K)
    ).essential_matrix
    calls |= {
        "FundamentalMatrixComputation/Magsac": lambda: fundamental.process(
            FundamentalMatrixComputationInputs(source=source, sink=sink)
        ),
        "EssentialMatrixComputation/Magsac": lambda: essential.process(
            EssentialMatrixComputationInputs(source=source, sink=sink, source_camera=K)
        ),
        "HomographyComputation/Magsac": lambda: homography.process(
            HomographyComputationInputs(source=source, sink=plane)
        ),
        "CamerasTransformEstimation/EssentialDecomposition": lambda: decompose.process(
            CamerasTransformEstimationInputs(essential_matrix=E, source=source, sink=sink, source_camera=K)
        ),
    }
    cloud = rng.uniform(-2.0, 2.0, (1000, 3))
    moved_cloud = cloud[:, [1, 2, 0]] + rng.normal(0.0, 0.01, cloud.shape)
    mixed = np.vstack([moved_cloud[:500], rng.uniform(-2.0, 2.0, (500, 3))])
    rigid, robust = node("transform_estimation_3d"), node("transform_estimation_3d", "TruncatedGnc")
    calls |= {
        "TransformEstimation3D/LeastSquares": lambda: rigid.process(
            TransformEstimation3DInputs(source=cloud, sink=moved_cloud)
        ),
        "TransformEstimation3D/TruncatedGnc": lambda: robust.process(
            TransformEstimation3DInputs(source=cloud, sink=mixed)
        ),
    }
    tracks, _ = scene(2, (4.0, 30.0), 100_000)
    triangulate, adjust = node("n_view_triangulation"), node("bundle_optimization", covariances="none")
    covariances = node("bundle_optimization")
    problem = ring()[0]
    calls |= {
        "NViewTriangulation/LinearThenReprojection": lambda: triangulate.process(
            NViewTriangulationInputs(tracks=tracks)
        ),
        "BundleOptimization/SchurLm": lambda: adjust.process(BundleOptimizationInputs(problem=problem)),
        "BundleOptimization/SchurLm with covariances": lambda: covariances.process(
            BundleOptimizationInputs(problem=problem)
        ),
    }
    return {name: measure(call, rounds) for name, call in calls.items()}


def matching_costs(left: np.ndarray, right: np.ndarray, rounds: int) -> dict[str, Any]:
    """Return the cost of each implementation of feature_matching on a stereo pair."""
    report = {}
    for name in feature_matching.VARIANTS:
        dfpc = feature_matching.make_matcher(name)
        report[name] = measure(lambda dfpc=dfpc: feature_matching.match_images(dfpc, left, right), rounds)
        report[name]["matches"] = len(feature_matching.match_images(dfpc, left, right)[0])
    return report


def dfpc_costs(rounds: int) -> dict[str, Any]:
    """Return the cost of the DFPCs triangulation and bundle_adjustment."""
    tracks, problem = scene(2, (4.0, 30.0), 100_000)[0], ring()[0]
    report = {}
    for name, variant, port, value in (
        ("triangulation", "Reprojection", "tracks", tracks),
        ("bundle_adjustment", "LeastSquares", "problem", problem),
        ("bundle_adjustment", "Robust", "problem", problem),
    ):
        dfpc = Registry.default().make_dfpc(name)
        dfpc.configure(implementation=variant)
        sample = Sample(port, 0, 0, value)
        report[f"{name}/{variant}"] = measure(
            lambda dfpc=dfpc, sample=sample: list(dfpc.step(sample)), rounds
        )
    return report


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    default_data = Path(__file__).resolve().parents[2] / "shared" / "data"
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("CDFF_DATA") or default_data))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--peer-python", help="interpreter of an environment with pycolmap")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    cv2.setNumThreads(1)
    images = sorted((args.data / "kitti_stereo").rglob("*.png"))
    left = grey(images[0])
    right = grey(next(p for p in images if p.name == images[0].name and p.parent != images[0].parent))
    report: dict[str, Any] = {
        "benchmark": "seeing",
        "python": platform.python_version(),
        "threads": os.environ.get("OMP_NUM_THREADS", "all"),
        "load_1min": os.getloadavg()[0],
        "dfns": dfn_costs(left, args.rounds),
        "feature_matching": matching_costs(left, right, args.rounds),
        "compounds": dfpc_costs(args.rounds),
        "gtsam_bundle_adjustment_cpu_s": solve_with_gtsam(ring()[0], 1e-7)[1],
    }
    if args.peer_python:
        result, cpu_s = colmap.matches(args.peer_python, [(left, right)])[0]
        report["colmap_sift"] = {"cpu_s": cpu_s, "matches": len(result)}
    write_report(report, args.out)


if __name__ == "__main__":
    main()

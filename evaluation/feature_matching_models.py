# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate the covariances of two-view models on simulated pairs with 30 % wrong matches."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.cameras_transform_estimation.interface import CamerasTransformEstimationInputs
from cdff_core.dfns.essential_matrix_computation.interface import EssentialMatrixComputationInputs
from cdff_core.dfns.fundamental_matrix_computation.interface import FundamentalMatrixComputationInputs
from cdff_core.dfns.homography_computation.interface import HomographyComputationInputs
from cdff_core.imaging.sampson import sampson
from cdff_core.imaging.two_view import transfer

Float = NDArray[np.float64]
#: Page that contains the table of this evaluation.
PAGE = "feature_matching"
TRIALS = 500
#: Numbers of point pairs, used in turn by the trials.
PAIRS = (60, 120, 300, 900)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the NEES per degree of freedom of each model (simulated data)."""
    cv2.setNumThreads(1)
    progress(f"feature_matching_models: {TRIALS} trials")
    return model_consistency(TRIALS)


def two_views(seed: int, pairs: int = 300, wrong: float = 0.3, sigma_px: float = 0.5) -> dict[str, Any]:
    """Return noisy point pairs of two cameras with a fraction of wrong matches, and the true values."""
    rng = np.random.default_rng(seed)
    K = np.array([[700.0, 0.0, 320.0], [0.0, 700.0, 240.0], [0.0, 0.0, 1.0]])
    direction = rng.normal(size=3)
    T = se3.transform(
        se3.exp_so3(rng.normal(0, 0.1, 3)), direction / np.linalg.norm(direction)
    )  # T_right_left
    source = np.column_stack([rng.uniform(20, 620, pairs), rng.uniform(20, 460, pairs)])
    depth = rng.uniform(4.0, 20.0, pairs)
    points = np.column_stack([source, np.ones(pairs)]) @ np.linalg.inv(K).T * depth[:, None]
    image = se3.transform_points(T, points) @ K.T
    exact_pixels = source.copy(), image[:, :2] / image[:, 2:]
    sink = exact_pixels[1] + rng.normal(0, sigma_px, (pairs, 2))
    outliers = rng.random(pairs) < wrong
    sink[outliers] = np.column_stack([rng.uniform(0, 640, pairs), rng.uniform(0, 480, pairs)])[outliers]
    return {
        "source": source + rng.normal(0, sigma_px, (pairs, 2)),
        "sink": sink,
        "K": K,
        "T": T,
        "exact": exact_pixels,
    }


def plane_views(seed: int, pairs: int, wrong: float = 0.3, sigma_px: float = 0.5) -> dict[str, Any]:
    """Return noisy point pairs of a plane in two images with a fraction of wrong matches, and the true
    values.
    """
    rng = np.random.default_rng(seed)
    exact = np.column_stack([rng.uniform(20, 620, pairs), rng.uniform(20, 460, pairs)])
    H = np.eye(3) + rng.normal(0, 0.1, (3, 3)) * [[1, 1, 100], [1, 1, 100], [1e-3, 1e-3, 0]]
    image = transfer(H, exact)
    sink = image + rng.normal(0, sigma_px, (pairs, 2))
    outliers = rng.random(pairs) < wrong
    sink[outliers] = np.column_stack([rng.uniform(0, 640, pairs), rng.uniform(0, 480, pairs)])[outliers]
    return {"source": exact + rng.normal(0, sigma_px, (pairs, 2)), "sink": sink, "exact": (exact, image)}


#: Models whose covariance contains errors of the cameras, which the simulated views do not have.
_CAMERA_MODELS = ("essential_matrix_computation", "cameras_transform_estimation")


def model_consistency(trials: int) -> dict[str, Any]:
    """Return the NEES of each model relative to its expected value; 1 if the covariance is consistent."""
    nodes = {}
    for model in (
        "fundamental_matrix_computation",
        "homography_computation",
        "essential_matrix_computation",
        "cameras_transform_estimation",
    ):
        nodes[model] = Registry.default().make_dfn(model)
        exact_cameras = {"principal_point_ratio": 0.0, "lens_edge_px": 0.0}
        nodes[model].configure(exact_cameras if model in _CAMERA_MODELS else {})
    nees: dict[str, list[float]] = {"fundamental": [], "homography": [], "essential": [], "transform": []}
    for seed in range(trials):
        pairs = PAIRS[seed % len(PAIRS)]
        views, plane = two_views(seed, pairs), plane_views(seed, pairs)
        points = {"source": views["source"], "sink": views["sink"]}
        F = nodes["fundamental_matrix_computation"].process(FundamentalMatrixComputationInputs(**points))
        nees["fundamental"].append(_fundamental_nees(F.fundamental_matrix, F.covariance, *views["exact"]))
        H = nodes["homography_computation"].process(
            HomographyComputationInputs(source=plane["source"], sink=plane["sink"])
        )
        nees["homography"].append(_homography_nees(H.homography, H.covariance, *plane["exact"]))
        E = nodes["essential_matrix_computation"].process(
            EssentialMatrixComputationInputs(**points, source_camera=views["K"])
        )
        nees["essential"].append(_essential_nees(E.essential_matrix, E.covariance, views["T"]))
        outputs = nodes["cameras_transform_estimation"].process(
            CamerasTransformEstimationInputs(
                essential_matrix=E.essential_matrix, **points, source_camera=views["K"]
            )
        )
        nees["transform"].append(
            _nees_ratio(cov.pose_error(se3.inverse(views["T"]), outputs.transform), outputs.covariance, 5)
        )
    return {name: {"trials": trials, "nees_ratio": _ratio(values)} for name, values in nees.items()}


def _homography_nees(H: Float, covariance: Float, source: Float, sink: Float) -> float:
    """Return the mean NEES, divided by 2, of exact points transferred by a homography with covariance."""
    steps = 1e-6 * np.eye(9).reshape(9, 3, 3)
    J = np.stack([(transfer(H + d, source) - transfer(H - d, source)) / 2e-6 for d in steps], axis=2)
    error = transfer(H, source) - sink
    spreads = np.einsum("nai,ij,nbj->nab", J, covariance, J)
    return float(np.mean(np.einsum("na,nab,nb->n", error, np.linalg.inv(spreads), error)) / 2.0)


def _fundamental_nees(F: Float, covariance: Float, source: Float, sink: Float) -> float:
    """Return the mean squared Sampson distance of exact pairs, relative to its variance due to F."""
    steps = 1e-6 * np.eye(9).reshape(9, 3, 3)
    J = np.stack(
        [(sampson(F + d, source, sink) - sampson(F - d, source, sink)) / 2e-6 for d in steps], axis=1
    )
    return float(np.mean(sampson(F, source, sink) ** 2 / np.einsum("ni,ij,nj->n", J, covariance, J)))


def _essential_nees(E: Float, covariance: Float, T: Float) -> float:
    """Return the NEES of the nine elements of an essential matrix, divided by its five degrees of freedom."""
    true = se3.skew(T[:3, 3]) @ T[:3, :3]
    return _nees_ratio((E - np.sign(np.sum(E * true)) * true).reshape(9), covariance, 5)


def _nees_ratio(error: Float, covariance: Float, rank: int) -> float:
    """Return the NEES divided by its expected value, within the ``rank`` directions of largest variance."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    components = vectors[:, -rank:].T @ (error / scale)
    return float(np.sum(components**2 / values[-rank:]) / rank)


def _ratio(values: list[float]) -> dict[str, float]:
    """Return the mean and its two-sided 95 % interval."""
    mean, half = float(np.mean(values)), 1.96 * float(np.std(values)) / len(values) ** 0.5
    return {"mean": round(mean, 3), "low": round(mean - half, 3), "high": round(mean + half, 3)}


def table(figures: dict[str, Any]) -> str:
    """Return the table with one row for each model."""
    lines = [
        "| model | trials | NEES per degree of freedom, mean (1 expected) | its 95 % interval |",
        "|---" * 4 + "|",
    ]
    for name, row in figures.items():
        ratio = row["nees_ratio"]
        lines.append(f"| {name} | {row['trials']} | {ratio['mean']} | {ratio['low']} to {ratio['high']} |")
    return "\n".join(lines)

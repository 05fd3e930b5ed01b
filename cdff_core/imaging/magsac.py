# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MAGSAC++ for two views, and common parts of estimators of two-view models.

Barath et al., MAGSAC++, a fast, reliable and accurate robust estimator, CVPR 2020,
doi:10.1109/CVPR42600.2020.00138.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.imaging.two_view import Fit, LensErrors, log10_false_alarms


class InlierConfig(DfnConfig):
    """Parameters of the test for inliers."""

    threshold_px: float = Field(
        1.0, gt=0, le=50, description="Upper bound of the standard deviation of inliers, pixels"
    )
    gate_sigmas: float = Field(
        3.0, ge=1, le=10, description="Least residual of an outlier, in standard deviations"
    )


class CalibrationConfig(DfnConfig):
    """Standard deviations of the errors of camera models; 0 for exact ones."""

    principal_point_ratio: float = Field(
        0.003,
        ge=0,
        le=1,
        description="Error of the principal point relative to the focal length, and of the tilt, radians",
    )
    lens_edge_px: float = Field(
        1.0,
        ge=0,
        le=100,
        description="Displacement at the edge of the image by the error of each other parameter of a camera",
    )

    @property
    def lenses(self) -> LensErrors:
        """Errors of both cameras."""
        return LensErrors(self.principal_point_ratio, self.lens_edge_px)


class MagsacConfig(InlierConfig):
    """Common parameters of the models; MAGSAC++ marginalises over noise up to ``threshold_px``."""

    max_iterations: int = Field(10_000, ge=10, le=1_000_000, description="Maximum number of samples drawn")
    confidence: float = Field(
        0.9999, gt=0, lt=1, description="Probability that at least one drawn sample contains no outlier"
    )
    min_inliers: int = Field(12, ge=8, description="Minimum number of inliers; fewer are refused")
    max_log10_false_alarms: float = Field(
        -3.0, le=0, description="Largest log10 of the expected number of models by chance"
    )
    seed: int = Field(0, ge=0, description="Seed of the random samples; every call starts from it")


def parameters(config: MagsacConfig) -> cv2.UsacParams:
    """Return the OpenCV parameters: MAGSAC++ scores and local optimisation, one thread, a fixed seed."""
    p = cv2.UsacParams()
    p.threshold, p.confidence, p.maxIterations = config.threshold_px, config.confidence, config.max_iterations
    p.score, p.loMethod, p.sampler = cv2.SCORE_METHOD_MAGSAC, cv2.LOCAL_OPTIM_SIGMA, cv2.SAMPLING_UNIFORM
    p.randomGeneratorState, p.isParallel = config.seed, False
    return p


def pairs(source: ArrayLike, sink: ArrayLike, minimum: int) -> tuple[FloatArray, FloatArray]:
    """Return both arrays of points as ``(n, 2)`` float64; raises RefusedError if there are too few pairs."""
    a, b = np.ascontiguousarray(source, np.float64), np.ascontiguousarray(sink, np.float64)
    if len(a) < minimum:
        raise RefusedError(
            f"{len(a)} pairs, expected at minimum {minimum}", [f"few_matches:{len(a)}<{minimum}"]
        )
    return a, b


def refuse_few_inliers(inliers: BoolArray, minimum: int) -> None:
    """Raise RefusedError if there are fewer than ``minimum`` inliers."""
    n = int(inliers.sum())
    if n < minimum:
        text = f"{n} of {len(inliers)} pairs agree on a model, expected {minimum}"
        raise RefusedError(text, [f"few_inliers:{n}<{minimum}"])


def estimated_matrix(estimator: Callable[..., tuple[Any, Any]], pairs: int, *arguments: Any) -> FloatArray:
    """Return the matrix estimated by a function of OpenCV; raises RefusedError if it finds none.

    OpenCV 5 fails with an assertion in ``setModelParameters`` if no sample has a model.
    """
    try:
        matrix, _ = estimator(*arguments)
    except cv2.error as error:
        if error.func != "setModelParameters":
            raise
        matrix = None
    return checked_matrix(matrix, pairs)


def checked_matrix(matrix: Any, pairs: int) -> FloatArray:
    """Return the matrix estimated by OpenCV; raises RefusedError if there is none."""
    if matrix is None or np.shape(matrix) != (3, 3) or not np.isfinite(matrix).all() or not np.any(matrix):
        raise RefusedError(f"no model fits {pairs} pairs", ["no_model"])
    return np.asarray(matrix, np.float64)


def outputs_of(
    fit: Fit, config: MagsacConfig, sink: FloatArray, minimal: int, *, is_line: bool = True
) -> dict[str, Any]:
    """Return the common outputs of the models; raises RefusedError if chance may explain the model."""
    refuse_few_inliers(fit.inliers, config.min_inliers)
    inliers = int(fit.inliers.sum())
    width, height = np.maximum(np.ptp(sink, axis=0), 1.0)
    band_px = max(config.gate_sigmas * fit.sigma_px, 0.25)
    chance = 2.0 * band_px * np.hypot(width, height) if is_line else np.pi * 2.0 * band_px**2
    alarms = log10_false_alarms(len(sink), inliers, float(chance / (width * height)), minimal)
    if alarms > config.max_log10_false_alarms:
        chance_text = f"as expected by chance (log10 of false alarms {alarms:.1f})"
        text = f"{inliers} of {len(sink)} pairs agree, {chance_text}"
        raise RefusedError(text, [f"by_chance:{alarms:.1f}>{config.max_log10_false_alarms:g}"])
    return {
        "covariance": fit.covariance,
        "inliers": fit.inliers,
        "residuals": fit.residuals,
        "sigma_px": fit.sigma_px,
        "log_false_alarms": alarms,
    }

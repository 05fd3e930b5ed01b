# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MAGSAC++ for two views, and what every estimator of a model of two views shares.

Barath et al., MAGSAC++, a fast, reliable and accurate robust estimator, CVPR 2020, doi:10.1109/CVPR42600.2020.00138.
"""

from __future__ import annotations

from typing import Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.imaging.two_view import Fit, log10_false_alarms

FloatArray = NDArray[np.float64]


class MagsacConfig(DfnConfig):
    """Parameters that the models share."""

    threshold_px: Annotated[float, Field(gt=0, le=50)] = 1.0
    max_iterations: Annotated[int, Field(ge=10, le=1_000_000)] = 10_000
    confidence: Annotated[float, Field(gt=0, lt=1)] = 0.9999
    gate_sigmas: Annotated[float, Field(ge=1, le=10)] = 3.0
    min_inliers: Annotated[int, Field(ge=8)] = 12
    max_log10_false_alarms: Annotated[float, Field(le=0)] = -3.0
    seed: Annotated[int, Field(ge=0)] = 0


def parameters(config: MagsacConfig) -> cv2.UsacParams:
    """OpenCV's parameters: MAGSAC++ scores and local optimisation, one thread, a stated seed."""
    p = cv2.UsacParams()
    p.threshold, p.confidence, p.maxIterations = config.threshold_px, config.confidence, config.max_iterations
    p.score, p.loMethod, p.sampler = cv2.SCORE_METHOD_MAGSAC, cv2.LOCAL_OPTIM_SIGMA, cv2.SAMPLING_UNIFORM
    p.randomGeneratorState, p.isParallel = config.seed, False
    return p


def refused_few(pairs: int, config: MagsacConfig) -> None:
    """Raise RefusedError where there are too few pairs to begin with."""
    if pairs < config.min_inliers:
        text = f"{pairs} pairs, expected at least {config.min_inliers}"
        raise RefusedError(text, [f"few_matches:{pairs}<{config.min_inliers}"])


def found(matrix: Any, pairs: int) -> FloatArray:
    """The matrix that OpenCV found; raises RefusedError where it found none."""
    if matrix is None or np.shape(matrix) != (3, 3) or not np.isfinite(matrix).all() or not np.any(matrix):
        raise RefusedError(f"no model fits {pairs} pairs", ["no_model"])
    return np.asarray(matrix, np.float64)


def accepted(fit: Fit, config: MagsacConfig, sink: FloatArray, minimal: int, is_line: bool) -> float:
    """How many such models chance would bring (log10); raises RefusedError where too many, or inliers too few."""
    inliers = int(fit.inliers.sum())
    if inliers < config.min_inliers:
        text = f"{inliers} of {len(sink)} pairs agree on a model, expected {config.min_inliers}"
        raise RefusedError(text, [f"few_inliers:{inliers}<{config.min_inliers}"])
    width, height = np.maximum(np.ptp(sink, axis=0), 1.0)
    reach = max(config.gate_sigmas * fit.sigma_px, 0.25)
    chance = 2.0 * reach * np.hypot(width, height) if is_line else np.pi * 2.0 * reach**2
    alarms = log10_false_alarms(len(sink), inliers, float(chance / (width * height)), minimal)
    if alarms > config.max_log10_false_alarms:
        text = (
            f"{inliers} of {len(sink)} pairs agree, which chance brings about too (log10 of false alarms {alarms:.1f})"
        )
        raise RefusedError(text, [f"by_chance:{alarms:.1f}>{config.max_log10_false_alarms:g}"])
    return alarms

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN CamerasTransformEstimation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class CamerasTransformEstimationInputs:
    """Inputs of one call.

    Attributes
    ----------
    essential_matrix : ndarray of float64, shape (3,3)
        E = [t]x R, x_sink = R x_source + t.
    source : ndarray of float64, shape (n,2)
        Points of the first image, pixels, without distortion.
    sink : ndarray of float64, shape (n,2)
        Their partners in the second image.
    source_camera : ndarray of float64, shape (3,3)
        Matrix of the first camera, pixels.
    sink_camera : ndarray of float64, shape (3,3), optional
        Matrix of the second camera; the first where absent.
    """

    essential_matrix: NDArray[np.float64]
    source: NDArray[np.float64]
    sink: NDArray[np.float64]
    source_camera: NDArray[np.float64]
    sink_camera: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class CamerasTransformEstimationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transform : ndarray of float64, shape (4,4)
        T_source_sink: pose of the second camera in the first, its translation of length 1.
    covariance : ndarray of float64, shape (6,6)
        Calibrated, [x y z rx ry rz], perturbation in the first camera's frame; nothing along the translation, whose
        length is not known.
    inliers : ndarray of bool, shape (n)
        Pairs that agree and meet in front of both cameras.
    parallax_deg : ndarray of float64, shape ()
        Median angle under which the cameras are seen from the points, degrees.
    """

    transform: NDArray[np.float64]
    covariance: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    parallax_deg: NDArray[np.float64]


class CamerasTransformEstimationInterface(
    Dfn[Any, CamerasTransformEstimationInputs, CamerasTransformEstimationOutputs]
):
    """Find how two calibrated cameras stand to each other, but for the scale, from their essential matrix and
    matches.
    """

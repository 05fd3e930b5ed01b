# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN CamerasTransformEstimation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CamerasTransformEstimationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    essential_matrix : ndarray of float64, shape (3,3)
        E = [t]x R, x_sink = R x_source + t.
    source : ndarray of float64, shape (n,2)
        Points of the first image, pixels, without distortion.
    sink : ndarray of float64, shape (n,2)
        Matching points of the second image, pixels, without distortion.
    source_camera : ndarray of float64, shape (3,3)
        Camera matrix of the first camera, pixels.
    sink_camera : ndarray of float64, shape (3,3), optional
        Camera matrix of the second camera; default: that of the first camera.
    """

    ARRAYS = ArrayPorts(
        {
            "essential_matrix": "float64[3,3]",
            "source": "float64[n,2]",
            "sink": "float64[n,2]",
            "source_camera": "float64[3,3]",
            "sink_camera": "float64[3,3]",
        },
        finite=["essential_matrix", "source", "sink"],
        optional=["sink_camera"],
    )

    essential_matrix: NDArray[np.float64]
    source: NDArray[np.float64]
    sink: NDArray[np.float64]
    source_camera: NDArray[np.float64]
    sink_camera: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CamerasTransformEstimationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transform : ndarray of float64, shape (4,4)
        T_source_sink: pose of the second camera in the frame of the first, with a translation of length 1.
    covariance : ndarray of float64, shape (6,6)
        Formal covariance due to image noise and camera errors, [x y z rx ry rz], perturbation in the first
        camera's frame; 0 along the translation, whose length is not observable.
    inliers : ndarray of bool, shape (n)
        True for pairs that agree with the pose and whose rays intersect in front of both cameras.
    parallax_deg : float
        Median parallax: angle at a point between the rays to both cameras, degrees.
    """

    transform: NDArray[np.float64]
    covariance: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    parallax_deg: float


class CamerasTransformEstimationInterface(
    Dfn[ConfigT, CamerasTransformEstimationInputs, CamerasTransformEstimationOutputs]
):
    """Estimate the relative pose of two calibrated cameras, up to scale, from their essential matrix
    and matches.
    """


#: Short names for the implementations.
Inputs = CamerasTransformEstimationInputs
Outputs = CamerasTransformEstimationOutputs
Interface = CamerasTransformEstimationInterface

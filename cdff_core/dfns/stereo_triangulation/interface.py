# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN StereoTriangulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StereoTriangulationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    features : ndarray of float64, shape (n,2)
        Column and row in the left image, pixels.
    disparities : ndarray of float64, shape (n)
        Disparities, pixels, above 0.
    camera_matrix : ndarray of float64, shape (3,3)
        Intrinsic matrix of the rectified left camera, pixels.
    baseline : float
        Distance between the cameras, metres.
    """

    ARRAYS = ArrayPorts(
        {"features": "float64[n,2]", "disparities": "float64[n]", "camera_matrix": "float64[3,3]"}
    )

    features: NDArray[np.float64]
    disparities: NDArray[np.float64]
    camera_matrix: NDArray[np.float64]
    baseline: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StereoTriangulationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points in the left camera's frame, metres.
    covariances : ndarray of float64, shape (n,3,3)
        Covariances of the points, square metres.
    """

    points: NDArray[np.float64]
    covariances: NDArray[np.float64]


class StereoTriangulationInterface(Dfn[ConfigT, StereoTriangulationInputs, StereoTriangulationOutputs]):
    """Triangulate points of the left image and their disparities, with covariance."""


#: Short names for the implementations.
Inputs = StereoTriangulationInputs
Outputs = StereoTriangulationOutputs
Interface = StereoTriangulationInterface

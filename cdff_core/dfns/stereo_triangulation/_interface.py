# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN StereoTriangulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class StereoTriangulationInputs:
    """Inputs of one call.

    Attributes
    ----------
    features : ndarray of float64, shape (n,2)
        Column and row in the left image, pixels.
    disparities : ndarray of float64, shape (n)
        Pixels, above 0.
    camera_matrix : ndarray of float64, shape (3,3)
        Rectified left camera, pixels.
    baseline : ndarray of float64, shape (1)
        Distance between the cameras, metres.
    """

    features: NDArray[np.float64]
    disparities: NDArray[np.float64]
    camera_matrix: NDArray[np.float64]
    baseline: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class StereoTriangulationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        In the left camera's frame, metres.
    covariances : ndarray of float64, shape (n,3,3)
        Of the points, square metres.
    """

    points: NDArray[np.float64]
    covariances: NDArray[np.float64]


class StereoTriangulationInterface(Dfn[Any, StereoTriangulationInputs, StereoTriangulationOutputs]):
    """Turn points of the left image and their disparities into points in space with their covariance."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN RectificationRefinement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RectificationRefinementInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    features : ndarray of float64, shape (n,2)
        Column and row in the left image, pixels.
    disparities : ndarray of float64, shape (n)
        Disparity of each point, pixels.
    row_offsets : ndarray of float64, shape (n), optional
        Row in the right minus row in the left image, pixels; if absent, the previous estimate is used.
    camera_matrix : ndarray of float64, shape (3,3)
        Intrinsic matrix of the rectified left camera, pixels.
    """

    ARRAYS = ArrayPorts(
        {
            "features": "float64[n,2]",
            "disparities": "float64[n]",
            "row_offsets": "float64[n]",
            "camera_matrix": "float64[3,3]",
        },
        optional=["row_offsets"],
    )

    features: NDArray[np.float64]
    disparities: NDArray[np.float64]
    camera_matrix: NDArray[np.float64]
    row_offsets: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RectificationRefinementOutputs:
    """Outputs of one call.

    Attributes
    ----------
    corrections : ndarray of float64, shape (n)
        Corrections to add to the disparities, pixels, as far as row offsets determine them.
    basis : ndarray of float64, shape (n,2)
        Derivatives of the disparities with respect to the two parameters that row offsets do not determine,
        an offset (px) and the decentring (px).
    row_residuals : ndarray of float64, shape (n)
        Row offsets minus their estimate, pixels; NaN without row offsets.
    coefficients : ndarray of float64, shape (4)
        Coefficients of 1, x, y and xy (normalised coordinates) in the row offset, pixels.
    open_covariance : ndarray of float64, shape (2,2)
        Prior covariance of the offset and the decentring, square pixels.
    """

    corrections: NDArray[np.float64]
    basis: NDArray[np.float64]
    row_residuals: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    open_covariance: NDArray[np.float64]


class RectificationRefinementInterface(
    Dfn[ConfigT, RectificationRefinementInputs, RectificationRefinementOutputs]
):
    """Estimate residual errors of a stereo rectification from row offsets, and their effect on
    disparities.
    """


#: Short names for the implementations.
Inputs = RectificationRefinementInputs
Outputs = RectificationRefinementOutputs
Interface = RectificationRefinementInterface

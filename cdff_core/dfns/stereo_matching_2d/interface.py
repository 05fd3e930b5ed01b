# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN StereoMatching2D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StereoMatching2DInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    left : ndarray of uint8, shape (r,c)
        Rectified grey image of the left camera.
    right : ndarray of uint8, shape (r,c)
        Rectified grey image of the right camera.
    features : ndarray of float64, shape (n,2)
        Points of the left image, column and row, pixels.
    guess : ndarray of float64, shape (n), optional
        Expected disparities, pixels; without it the whole range is searched.
    slopes : ndarray of float64, shape (n,2), optional
        Derivatives of the disparity with respect to column and row across each patch; default: estimated.
    """

    ARRAYS = ArrayPorts(
        {
            "left": "uint8[r,c]",
            "right": "uint8[r,c]",
            "features": "float64[n,2]",
            "guess": "float64[n]",
            "slopes": "float64[n,2]",
        },
        optional=["guess", "slopes"],
    )

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    features: NDArray[np.float64]
    guess: NDArray[np.float64] | None = None
    slopes: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StereoMatching2DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    disparities : ndarray of float64, shape (n)
        Column in the left minus column in the right image, pixels; undefined if not valid.
    row_offsets : ndarray of float64, shape (n)
        Row in the right minus row in the left image, pixels: residual error of the rectification.
    slopes : ndarray of float64, shape (n,2)
        Derivatives of the disparity with respect to column and row across each patch, 0 if not observable.
    valid : ndarray of bool, shape (n)
        True for a unique match.
    """

    disparities: NDArray[np.float64]
    row_offsets: NDArray[np.float64]
    slopes: NDArray[np.float64]
    valid: NDArray[np.bool_]


class StereoMatching2DInterface(Dfn[ConfigT, StereoMatching2DInputs, StereoMatching2DOutputs]):
    """Match points of the left image of a rectified pair in the right image with sub-pixel accuracy."""


#: Short names for the implementations.
Inputs = StereoMatching2DInputs
Outputs = StereoMatching2DOutputs
Interface = StereoMatching2DInterface

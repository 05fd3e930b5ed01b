# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN StereoMatching2D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class StereoMatching2DInputs:
    """Inputs of one call.

    Attributes
    ----------
    left : ndarray of uint8, shape (r,c)
        Rectified grey image.
    right : ndarray of uint8, shape (r,c)
        Rectified grey image of the camera to its right.
    features : ndarray of float64, shape (n,2)
        Points of the left image, column and row, pixels.
    guess : ndarray of float64, shape (n), optional
        Expected disparities, pixels; the whole range is searched where absent.
    slopes : ndarray of float64, shape (n,2), optional
        Derivatives of the disparity by column and row across each patch; found along where absent.
    """

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    features: NDArray[np.float64]
    guess: NDArray[np.float64] | None = None
    slopes: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class StereoMatching2DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    disparities : ndarray of float64, shape (n)
        Column in the left minus column in the right image, pixels; meaningless where not valid.
    row_offsets : ndarray of float64, shape (n)
        Row in the right minus row in the left image, pixels: what the rectification left.
    slopes : ndarray of float64, shape (n,2)
        Derivatives of the disparity by column and row across each patch, 0 where they cannot be told.
    valid : ndarray of bool, shape (n)
        Found once and only once.
    """

    disparities: NDArray[np.float64]
    row_offsets: NDArray[np.float64]
    slopes: NDArray[np.float64]
    valid: NDArray[np.bool_]


class StereoMatching2DInterface(Dfn[Any, StereoMatching2DInputs, StereoMatching2DOutputs]):
    """Find points of the left image of a rectified pair in the right one, to a fraction of a pixel."""

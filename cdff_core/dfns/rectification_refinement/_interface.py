# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN RectificationRefinement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class RectificationRefinementInputs:
    """Inputs of one call.

    Attributes
    ----------
    features : ndarray of float64, shape (n,2)
        Column and row in the left image, pixels.
    disparities : ndarray of float64, shape (n)
        Pixels.
    row_offsets : ndarray of float64, shape (n), optional
        Row in the right minus row in the left image, pixels; learnt from where given.
    camera_matrix : ndarray of float64, shape (3,3)
        Rectified left camera, pixels.
    """

    features: NDArray[np.float64]
    disparities: NDArray[np.float64]
    camera_matrix: NDArray[np.float64]
    row_offsets: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RectificationRefinementOutputs:
    """Outputs of one call.

    Attributes
    ----------
    corrections : ndarray of float64, shape (n)
        To add to the disparities, pixels: what the rows prove.
    basis : ndarray of float64, shape (n,2)
        What the rows leave open: derivatives of the disparity by an offset (px) and by the decentring (px).
    row_residuals : ndarray of float64, shape (n)
        Row offsets that are not explained, pixels; NaN without row offsets.
    coefficients : ndarray of float64, shape (4)
        Row offset by 1, x, y and xy of normalised coordinates, pixels.
    open_covariance : ndarray of float64, shape (2,2)
        Of the offset and the decentring before any motion is seen, square pixels.
    """

    corrections: NDArray[np.float64]
    basis: NDArray[np.float64]
    row_residuals: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    open_covariance: NDArray[np.float64]


class RectificationRefinementInterface(Dfn[Any, RectificationRefinementInputs, RectificationRefinementOutputs]):
    """Learn from row offsets what a stereo rectification left over, and say what that does to disparities."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesExtraction2D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class FeaturesExtraction2DInputs:
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of uint8, shape (r,c)
        Grey image.
    """

    image: NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class FeaturesExtraction2DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    features : ndarray of float64, shape (n,2)
        Column and row of each point, pixels, the best of each cell first.
    scores : ndarray of float64, shape (n)
        Higher is better: GridGftt smaller eigenvalue of the mean gradient matrix (DN/px)^2, GridFast and
        AdaptiveFast the corner score DN, Sift the contrast, Orb the measure of Harris.
    sizes : ndarray of float64, shape (n), optional
        Diameter of each point, pixels; absent from detectors of corners of one size.
    angles : ndarray of float64, shape (n), optional
        Direction of each point, degrees clockwise from x; absent as sizes.
    """

    features: NDArray[np.float64]
    scores: NDArray[np.float64]
    sizes: NDArray[np.float64] | None = None
    angles: NDArray[np.float64] | None = None


class FeaturesExtraction2DInterface(Dfn[Any, FeaturesExtraction2DInputs, FeaturesExtraction2DOutputs]):
    """Find points that a patch around them locates well in both directions, spread over the whole image."""

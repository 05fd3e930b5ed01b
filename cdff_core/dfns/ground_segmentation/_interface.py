# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN GroundSegmentation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class GroundSegmentationInputs:
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points in a frame with z up, metres; rows that are not finite are never ground.
    """

    points: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class GroundSegmentationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    ground : ndarray of int64, shape (m)
        Row of each ground point in the input.
    ground_points : ndarray of float64, shape (m,3)
        The ground points, in their order, metres.
    height_above_ground : ndarray of float64, shape (n)
        Height of each point above the interpolated ground, metres; NaN where the point is not finite.
    """

    ground: NDArray[np.int64]
    ground_points: NDArray[np.float64]
    height_above_ground: NDArray[np.float64]


class GroundSegmentationInterface(Dfn[Any, GroundSegmentationInputs, GroundSegmentationOutputs]):
    """Tells the points of a cloud seen from above that lie on the ground from those on what stands on it."""

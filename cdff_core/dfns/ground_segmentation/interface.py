# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN GroundSegmentation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GroundSegmentationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points in a frame with z up, metres; rows that are not finite are never ground.
    """

    ARRAYS = ArrayPorts({"points": "float64[n,3]"})

    points: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GroundSegmentationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    ground : ndarray of int64, shape (m)
        Row of each ground point in the input.
    ground_points : ndarray of float64, shape (m,3)
        The ground points, in input order, metres.
    height_above_ground : ndarray of float64, shape (n)
        Height of each point above the interpolated ground, metres; NaN if the point is not finite.
    """

    ground: NDArray[np.int64]
    ground_points: NDArray[np.float64]
    height_above_ground: NDArray[np.float64]


class GroundSegmentationInterface(Dfn[ConfigT, GroundSegmentationInputs, GroundSegmentationOutputs]):
    """Classify the points of a cloud observed from above as ground or object."""


#: Short names for the implementations.
Inputs = GroundSegmentationInputs
Outputs = GroundSegmentationOutputs
Interface = GroundSegmentationInterface

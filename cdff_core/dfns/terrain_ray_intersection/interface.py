# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN TerrainRayIntersection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TerrainRayIntersectionInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    heights : ndarray of float64, shape (r,c)
        Heights of the cells, metres, row 0 at the top; NaN where unknown.
    variances : ndarray of float64, shape (r,c), optional
        Variances of the heights, square metres; default: 0.
    corner : ndarray of float64, shape (2)
        X and y of the outer corner of cell (0, 0), metres.
    resolution : float
        Size of a cell, metres.
    origin : ndarray of float64, shape (3)
        Start of the lines of sight in the frame of the map, metres.
    directions : ndarray of float64, shape (n,3)
        Unit vectors in the frame of the map.
    elevation_sigmas : ndarray of float64, shape (n)
        Standard deviations of the elevation of the directions, radians.
    """

    ARRAYS = ArrayPorts(
        {
            "heights": "float64[r,c]",
            "variances": "float64[r,c]",
            "corner": "float64[2]",
            "origin": "float64[3]",
            "directions": "float64[n,3]",
            "elevation_sigmas": "float64[n]",
        },
        finite=["corner", "origin", "directions"],
        positive=["resolution", "elevation_sigmas"],
        optional=["variances"],
    )

    heights: NDArray[np.float64]
    corner: NDArray[np.float64]
    resolution: float
    origin: NDArray[np.float64]
    directions: NDArray[np.float64]
    elevation_sigmas: NDArray[np.float64]
    variances: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TerrainRayIntersectionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    ranges : ndarray of float64, shape (n)
        Distances to the first intersection, metres; NaN if there is no intersection, or if cells in front
        of it are unknown.
    sigmas : ndarray of float64, shape (n)
        Standard deviations of the ranges, metres.
    """

    ranges: NDArray[np.float64]
    sigmas: NDArray[np.float64]


class TerrainRayIntersectionInterface(
    Dfn[ConfigT, TerrainRayIntersectionInputs, TerrainRayIntersectionOutputs]
):
    """Intersect lines of sight with an elevation map, with the standard deviation of the range."""


#: Short names for the implementations.
Inputs = TerrainRayIntersectionInputs
Outputs = TerrainRayIntersectionOutputs
Interface = TerrainRayIntersectionInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN DemRasterisation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import ElevationMap


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DemRasterisationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    frame : str, optional
        Frame of the points and of the map; default: map.
    resolution_m : float, optional
        Edge of a cell, metres; default: the configured value.
    points : ndarray of float64, shape (n,3)
        Points in the frame of the map, z up, metres; rows that are not finite are ignored.
    height_variance : ndarray of float64, shape (n), optional
        Variance of each height due to the pose, which the variance within a cell does not contain, square
        metres.
    stamps_ns : ndarray of int64, shape (n), optional
        Measurement time of each point, nanoseconds; default: 0.
    noise_variance : ndarray of float64, shape (n), optional
        Variance of each height due to sensor noise, square metres.
    intensity : ndarray of float64, shape (n), optional
        Brightness of each point, NaN if unknown.
    is_structure : ndarray of bool, shape (n), optional
        Points above the ground according to a ground filter; with overhang_gap_m they replace the search
        for vertical gaps.
    """

    ARRAYS = ArrayPorts(
        {
            "points": "float64[n,3]",
            "height_variance": "float64[n]",
            "stamps_ns": "int64[n]",
            "noise_variance": "float64[n]",
            "intensity": "float64[n]",
            "is_structure": "bool[n]",
        },
        positive=["resolution_m"],
        optional=[
            "resolution_m",
            "height_variance",
            "stamps_ns",
            "noise_variance",
            "intensity",
            "is_structure",
        ],
    )

    points: NDArray[np.float64]
    frame: str | None = None
    resolution_m: float | None = None
    height_variance: NDArray[np.float64] | None = None
    stamps_ns: NDArray[np.int64] | None = None
    noise_variance: NDArray[np.float64] | None = None
    intensity: NDArray[np.float64] | None = None
    is_structure: NDArray[np.bool_] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DemRasterisationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    map : ElevationMap
        Smallest aligned grid that contains all points; layers mean, variance, min, max, count, age_s, NaN
        if unobserved; auxiliary layers if noiseVariance, intensity or overhang_gap_m is given:
        pose_variance (mean of heightVariance), intensity (mean), first_age_s (age of the oldest
        measurement), overhang_m (lowest height of an overhang).
    """

    map: ElevationMap


class DemRasterisationInterface(Dfn[ConfigT, DemRasterisationInputs, DemRasterisationOutputs]):
    """Compute statistics of the heights of a cloud in each cell of a grid aligned with the frame of
    the cloud; cells without points are unobserved.
    """


#: Short names for the implementations.
Inputs = DemRasterisationInputs
Outputs = DemRasterisationOutputs
Interface = DemRasterisationInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ModelPoseSearch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelPoseSearchInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    scan : ndarray of float64, shape (n,3)
        Points of one body, metres; the sensor is at the origin.
    points : ndarray of float64, shape (p,3)
        Visible surface of the model, metres, by ModelPreparation.
    normals : ndarray of float64, shape (p,3)
        Outward unit normals of the points.
    grid_index : ndarray of int32, shape (a,b,c)
        Row of the point nearest to the centre of each cell.
    grid_low : ndarray of float64, shape (3)
        Corner of the first cell, metres.
    grid_cell_m : float
        Edge of a cell, metres.
    view_directions : ndarray of float64, shape (d,3)
        Directions from the model to viewers.
    view_centroids : ndarray of float64, shape (d,3)
        Mean of the points that are visible from each direction, metres.
    diameter_m : float
        Largest extent of the model, metres.
    sigma_m : float
        Standard deviation of a range, metres.
    """

    ARRAYS = ArrayPorts(
        {
            "scan": "float64[n,3]",
            "points": "float64[p,3]",
            "normals": "float64[p,3]",
            "grid_index": "int32[a,b,c]",
            "grid_low": "float64[3]",
            "view_directions": "float64[d,3]",
            "view_centroids": "float64[d,3]",
        },
        finite=["scan"],
        positive=["diameter_m", "sigma_m"],
    )

    scan: NDArray[np.float64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    grid_index: NDArray[np.int32]
    grid_low: NDArray[np.float64]
    grid_cell_m: float
    view_directions: NDArray[np.float64]
    view_centroids: NDArray[np.float64]
    diameter_m: float
    sigma_m: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelPoseSearchOutputs:
    """Outputs of one call.

    Attributes
    ----------
    poses : ndarray of float64, shape (k,4,4)
        Distinct poses T_sensor_model, best first.
    costs : ndarray of float64, shape (k)
        Mean truncated squared distance of the scan to the surface, 0 to 1.
    """

    poses: NDArray[np.float64]
    costs: NDArray[np.float64]


class ModelPoseSearchInterface(Dfn[ConfigT, ModelPoseSearchInputs, ModelPoseSearchOutputs]):
    """Search for the pose of a known body in a scan of this body, without a guess, by registration
    from start poses that show each side of the body to the sensor.
    """


#: Short names for the implementations.
Inputs = ModelPoseSearchInputs
Outputs = ModelPoseSearchOutputs
Interface = ModelPoseSearchInterface

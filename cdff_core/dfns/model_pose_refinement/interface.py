# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ModelPoseRefinement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelPoseRefinementInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    scan : ndarray of float64, shape (n,3)
        Points of one body, metres; the sensor is at the origin.
    poses : ndarray of float64, shape (k,4,4)
        Poses T_sensor_model to rank.
    drawn_vertices : ndarray of float64, shape (v,3)
        Vertices of the visible mesh, metres.
    drawn_triangles : ndarray of int64, shape (t,3)
        Triangles of the visible mesh.
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
    centre_m : ndarray of float64, shape (3)
        Centre of the model, metres.
    diameter_m : float
        Largest extent of the model, metres.
    sigma_m : float
        Standard deviation of a range, metres.
    sigma_is_upper_bound : bool, optional
        True to estimate the standard deviation from the ranges at the best pose, with sigmaM as upper
        bound.
    """

    ARRAYS = ArrayPorts(
        {
            "scan": "float64[n,3]",
            "poses": "float64[k,4,4]",
            "drawn_vertices": "float64[v,3]",
            "drawn_triangles": "int64[t,3]",
            "points": "float64[p,3]",
            "normals": "float64[p,3]",
            "grid_index": "int32[a,b,c]",
            "grid_low": "float64[3]",
            "centre_m": "float64[3]",
        },
        finite=["scan"],
        positive=["diameter_m", "sigma_m"],
    )

    scan: NDArray[np.float64]
    poses: NDArray[np.float64]
    drawn_vertices: NDArray[np.float64]
    drawn_triangles: NDArray[np.int64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    grid_index: NDArray[np.int32]
    grid_low: NDArray[np.float64]
    grid_cell_m: float
    centre_m: NDArray[np.float64]
    diameter_m: float
    sigma_m: float
    sigma_is_upper_bound: bool | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelPoseRefinementOutputs:
    """Outputs of one call.

    Attributes
    ----------
    poses : ndarray of float64, shape (j,4,4)
        Refined distinct poses T_sensor_model, best first.
    covariances : ndarray of float64, shape (j,6,6)
        Covariances of the poses, [x y z rx ry rz] in the sensor's frame; the covariances of all poses but
        the first are those of the registration.
    costs : ndarray of float64, shape (j)
        -2 log likelihood, up to a constant.
    rays : ndarray of float64, shape (j,4)
        Numbers of rays that agree with the model, that meet the model at another range, and that miss the
        model, and number of directions without a measurement in which the model should have been measured.
    sigma_m : float
        Standard deviation of a range that was used, including errors of the model, metres.
    """

    poses: NDArray[np.float64]
    covariances: NDArray[np.float64]
    costs: NDArray[np.float64]
    rays: NDArray[np.float64]
    sigma_m: float


class ModelPoseRefinementInterface(Dfn[ConfigT, ModelPoseRefinementInputs, ModelPoseRefinementOutputs]):
    """Rank and refine poses of a known body by the likelihood of a scan, and compute the covariance of
    the best pose. The likelihood contains the range differences of rays that meet the body, the
    rays that miss the body, and directions without a measurement in which the body should have been
    measured.
    """


#: Short names for the implementations.
Inputs = ModelPoseRefinementInputs
Outputs = ModelPoseRefinementOutputs
Interface = ModelPoseRefinementInterface

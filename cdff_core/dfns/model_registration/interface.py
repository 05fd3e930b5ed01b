# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ModelRegistration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelRegistrationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    scan : ndarray of float64, shape (n,3)
        Points near the body, moved to the time of the pose, metres; the sensor is at the origin.
    times_s : ndarray of float64, shape (n), optional
        Times at which the points were measured, relative to that of the pose, seconds.
    pose : ndarray of float64, shape (4,4)
        T_sensor_model at the start.
    prior_covariance : ndarray of float64, shape (k,k), optional
        Covariance of the errors of a predicted state; without it, the pose is assumed to be unknown within
        the capture range.
    prior_error : ndarray of float64, shape (k), optional
        Error of the predicted state relative to the start; 0 by default.
    state_jacobian : ndarray of float64, shape (12,k), optional
        Derivative of the errors of the pose, [x y z rx ry rz] in the sensor's axes, and of their rates,
        with respect to the errors of the state; by default the state is the pose.
    capture_m : float, optional
        Distance of the scan from the surface at the start, metres; a quarter of the diameter by default.
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
    """

    ARRAYS = ArrayPorts(
        {
            "scan": "float64[n,3]",
            "times_s": "float64[n]",
            "pose": "float64[4,4]",
            "prior_covariance": "float64[k,k]",
            "prior_error": "float64[k]",
            "state_jacobian": "float64[12,k]",
            "drawn_vertices": "float64[v,3]",
            "drawn_triangles": "int64[t,3]",
            "points": "float64[p,3]",
            "normals": "float64[p,3]",
            "grid_index": "int32[a,b,c]",
            "grid_low": "float64[3]",
            "centre_m": "float64[3]",
        },
        finite=["scan", "times_s"],
        positive=["capture_m", "diameter_m", "sigma_m"],
        optional=["times_s", "prior_covariance", "prior_error", "state_jacobian", "capture_m"],
    )

    scan: NDArray[np.float64]
    pose: NDArray[np.float64]
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
    times_s: NDArray[np.float64] | None = None
    prior_covariance: NDArray[np.float64] | None = None
    prior_error: NDArray[np.float64] | None = None
    state_jacobian: NDArray[np.float64] | None = None
    capture_m: float | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelRegistrationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pose : ndarray of float64, shape (4,4)
        Registered T_sensor_model.
    correction : ndarray of float64, shape (k)
        Error of the state to add to the start.
    covariance : ndarray of float64, shape (k,k)
        Covariance of the errors of the corrected state, including the information of the prediction.
    information : ndarray of float64, shape (6,6)
        Information of the points alone about the pose, [x y z rx ry rz] in the sensor's axes.
    weak_directions : ndarray of float64, shape (j,6)
        Directions that the points do not constrain: displacements in the sensor's axes and rotations about
        the centre, of unit length at half the diameter.
    agreement : float
        Fraction of the points whose range agrees with the model; without outline, only points that meet the
        model and are not in front of it are counted.
    in_front : float
        Fraction of the points in the direction of the model whose range is shorter, because another object
        hides the model.
    sigma_m : float
        Robust standard deviation of the range differences, metres.
    """

    pose: NDArray[np.float64]
    correction: NDArray[np.float64]
    covariance: NDArray[np.float64]
    information: NDArray[np.float64]
    weak_directions: NDArray[np.float64]
    agreement: float
    in_front: float
    sigma_m: float


class ModelRegistrationInterface(Dfn[ConfigT, ModelRegistrationInputs, ModelRegistrationOutputs]):
    """Register points with a known body, starting at a predicted pose. The covariance of the
    prediction constrains the directions that the points do not constrain. If the points have times,
    the rate of the pose can be estimated too.
    """


#: Short names for the implementations.
Inputs = ModelRegistrationInputs
Outputs = ModelRegistrationOutputs
Interface = ModelRegistrationInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN MeasuredPoseRefinement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MeasuredPoseRefinementInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points in the frame of the model, metres.
    pixels : ndarray of float64, shape (n,2)
        Column and row from which the offsets were measured.
    normals : ndarray of float64, shape (n,2)
        Unit directions of the offsets in the image.
    offsets : ndarray of float64, shape (n,h)
        Measured offsets of each point, one per hypothesis, px; NaN for missing hypotheses.
    sigmas : ndarray of float64, shape (n), optional
        Standard deviation of the offsets of each point, px; by default the parameter sigma_px.
    camera_matrix : ndarray of float64, shape (3,3)
        Camera matrix, px.
    pose : ndarray of float64, shape (4,4)
        T_camera_model at the start.
    limit_px : float
        Residual above which a point has no weight in the first step, px.
    prior_covariance : ndarray of float64, shape (k,k)
        Covariance of the errors of the predicted state; the first six errors are those of the pose, [x y z
        rx ry rz] in the camera's axes.
    prior_error : ndarray of float64, shape (k), optional
        Error of the predicted state relative to the start; 0 by default.
    """

    ARRAYS = ArrayPorts(
        {
            "points": "float64[n,3]",
            "pixels": "float64[n,2]",
            "normals": "float64[n,2]",
            "offsets": "float64[n,h]",
            "sigmas": "float64[n]",
            "camera_matrix": "float64[3,3]",
            "pose": "float64[4,4]",
            "prior_covariance": "float64[k,k]",
            "prior_error": "float64[k]",
        },
        finite=["points", "pixels", "normals", "sigmas"],
        positive=["limit_px"],
        optional=["sigmas", "prior_error"],
    )

    points: NDArray[np.float64]
    pixels: NDArray[np.float64]
    normals: NDArray[np.float64]
    offsets: NDArray[np.float64]
    camera_matrix: NDArray[np.float64]
    pose: NDArray[np.float64]
    limit_px: float
    prior_covariance: NDArray[np.float64]
    sigmas: NDArray[np.float64] | None = None
    prior_error: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MeasuredPoseRefinementOutputs:
    """Outputs of one call.

    Attributes
    ----------
    correction : ndarray of float64, shape (k)
        Error of the state to add to the start.
    covariance : ndarray of float64, shape (k,k)
        Covariance of the errors of the corrected state, including the information of the prediction.
    information : ndarray of float64, shape (6,6)
        Information of the points alone about the pose.
    agreement : float
        Fraction of the points that have a hypothesis within three standard deviations.
    sigma_px : float
        Robust standard deviation of the residuals, px; NaN without residuals.
    """

    correction: NDArray[np.float64]
    covariance: NDArray[np.float64]
    information: NDArray[np.float64]
    agreement: float
    sigma_px: float


class MeasuredPoseRefinementInterface(
    Dfn[ConfigT, MeasuredPoseRefinementInputs, MeasuredPoseRefinementOutputs]
):
    """Correct a predicted state of a body with the offsets between points on its edges and the image
    edges, measured along the edge normals; a point may have several hypotheses.
    """


#: Short names for the implementations.
Inputs = MeasuredPoseRefinementInputs
Outputs = MeasuredPoseRefinementOutputs
Interface = MeasuredPoseRefinementInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN StereoMotionEstimation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StereoMotionEstimationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    reference : ndarray of float64, shape (n,3)
        Column, row and disparity of each point in the reference pair, pixels.
    current : ndarray of float64, shape (n,3)
        Column, row and disparity of each point in the current pair, pixels.
    camera_matrix : ndarray of float64, shape (3,3)
        Intrinsic matrix of the rectified left camera, pixels.
    baseline : float
        Distance between the cameras, metres.
    guess : ndarray of float64, shape (4,4)
        Initial T_reference_current.
    reference_basis : ndarray of float64, shape (n,k), optional
        Derivatives of the reference disparities with respect to k calibration parameters, which are then
        estimated too.
    current_basis : ndarray of float64, shape (n,k), optional
        Derivatives of the current disparities with respect to the same parameters.
    calibration : ndarray of float64, shape (k), optional
        Prior estimate of the calibration parameters, pixels.
    calibration_covariance : ndarray of float64, shape (k,k), optional
        Covariance of the prior, square pixels.
    """

    ARRAYS = ArrayPorts(
        {
            "reference": "float64[n,3]",
            "current": "float64[n,3]",
            "camera_matrix": "float64[3,3]",
            "guess": "float64[4,4]",
            "reference_basis": "float64[n,k]",
            "current_basis": "float64[n,k]",
            "calibration": "float64[k]",
            "calibration_covariance": "float64[k,k]",
        },
        optional=["reference_basis", "current_basis", "calibration", "calibration_covariance"],
    )

    reference: NDArray[np.float64]
    current: NDArray[np.float64]
    camera_matrix: NDArray[np.float64]
    baseline: float
    guess: NDArray[np.float64]
    reference_basis: NDArray[np.float64] | None = None
    current_basis: NDArray[np.float64] | None = None
    calibration: NDArray[np.float64] | None = None
    calibration_covariance: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StereoMotionEstimationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    motion : ndarray of float64, shape (4,4)
        T_reference_current, metres.
    covariance : ndarray of float64, shape (6,6)
        Covariance of the motion, [x y z rx ry rz], perturbation in the reference frame: noise and errors
        common to all points.
    noise_covariance : ndarray of float64, shape (6,6)
        Part of the covariance due to the noise of these two pairs.
    common_response : ndarray of float64, shape (6,14)
        Effect on the motion, [x y z rx ry rz], of one standard deviation of each error common to all
        points. Columns 0-5, tracking: offsets of column, row and disparity, magnification, stretch of rows,
        rotation of the image. Columns 6-13, calibration: focal length, baseline, column and row of the
        principal point, rotations about the optical axis and the baseline, distortion of the left and the
        right camera.
    calibration_response : ndarray of float64, shape (6,k)
        Derivatives of the motion with respect to the calibration parameters, per pixel.
    inliers : ndarray of bool, shape (n)
        Points whose residual agrees with the noise model.
    residuals : ndarray of float64, shape (n,3)
        Measured minus predicted column, row and disparity, pixels.
    unit_variance : float
        Variance of unit weight: 1 if the residuals agree with the noise model.
    conditioning : float
        Ratio of the largest to the smallest eigenvalue of the normal matrix, with rotations scaled by the
        effective distance of the points.
    calibration : ndarray of float64, shape (k)
        Calibration parameters after this pair, pixels.
    calibration_covariance : ndarray of float64, shape (k,k)
        Covariance of the calibration parameters after this pair, square pixels.
    """

    motion: NDArray[np.float64]
    covariance: NDArray[np.float64]
    noise_covariance: NDArray[np.float64]
    common_response: NDArray[np.float64]
    calibration_response: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    residuals: NDArray[np.float64]
    unit_variance: float
    conditioning: float
    calibration: NDArray[np.float64]
    calibration_covariance: NDArray[np.float64]


class StereoMotionEstimationInterface(
    Dfn[ConfigT, StereoMotionEstimationInputs, StereoMotionEstimationOutputs]
):
    """Refine the motion between two rectified stereo pairs over all matched points, with its
    covariance and an update of calibration parameters.
    """


#: Short names for the implementations.
Inputs = StereoMotionEstimationInputs
Outputs = StereoMotionEstimationOutputs
Interface = StereoMotionEstimationInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN StereoMotionEstimation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class StereoMotionEstimationInputs:
    """Inputs of one call.

    Attributes
    ----------
    reference : ndarray of float64, shape (n,3)
        Column, row and disparity in the reference pair, pixels.
    current : ndarray of float64, shape (n,3)
        Column, row and disparity in the current pair, pixels.
    camera_matrix : ndarray of float64, shape (3,3)
        Rectified left camera, pixels.
    baseline : ndarray of float64, shape (1)
        Distance between the cameras, metres.
    guess : ndarray of float64, shape (4,4)
        T_reference_current to start from.
    reference_basis : ndarray of float64, shape (n,k), optional
        Derivatives of the reference disparities by calibration parameters to estimate along.
    current_basis : ndarray of float64, shape (n,k), optional
        Derivatives of the current disparities by the same.
    calibration : ndarray of float64, shape (k), optional
        What is known of those parameters, pixels.
    calibration_covariance : ndarray of float64, shape (k,k), optional
        How well, square pixels.
    """

    reference: NDArray[np.float64]
    current: NDArray[np.float64]
    camera_matrix: NDArray[np.float64]
    baseline: NDArray[np.float64]
    guess: NDArray[np.float64]
    reference_basis: NDArray[np.float64] | None = None
    current_basis: NDArray[np.float64] | None = None
    calibration: NDArray[np.float64] | None = None
    calibration_covariance: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class StereoMotionEstimationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    motion : ndarray of float64, shape (4,4)
        T_reference_current, metres.
    covariance : ndarray of float64, shape (6,6)
        Of the motion, [x y z rx ry rz], perturbation in the reference frame: noise and what all points share.
    noise_covariance : ndarray of float64, shape (6,6)
        Its part that is new with these two pairs.
    common_response : ndarray of float64, shape (6,5)
        What one sigma of an error common to all points adds to the motion: a shift in column, row and disparity, a
        magnification, a stretch of rows.
    calibration_response : ndarray of float64, shape (6,k)
        Derivatives of the motion by the calibration parameters, per pixel.
    inliers : ndarray of bool, shape (n)
        Points whose residual agrees with the noise model.
    residuals : ndarray of float64, shape (n,3)
        Measured minus predicted column, row and disparity, pixels.
    unit_variance : ndarray of float64, shape (1)
        Variance of unit weight: 1 when the residuals are as large as the noise model says.
    conditioning : ndarray of float64, shape (1)
        Largest over smallest eigenvalue of the normal matrix, rotations scaled by the points' median distance.
    calibration : ndarray of float64, shape (k)
        The calibration parameters after this pair, pixels.
    calibration_covariance : ndarray of float64, shape (k,k)
        How well they are known now, square pixels.
    """

    motion: NDArray[np.float64]
    covariance: NDArray[np.float64]
    noise_covariance: NDArray[np.float64]
    common_response: NDArray[np.float64]
    calibration_response: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    residuals: NDArray[np.float64]
    unit_variance: NDArray[np.float64]
    conditioning: NDArray[np.float64]
    calibration: NDArray[np.float64]
    calibration_covariance: NDArray[np.float64]


class StereoMotionEstimationInterface(Dfn[Any, StereoMotionEstimationInputs, StereoMotionEstimationOutputs]):
    """Refine the motion between two rectified stereo pairs over all matched points, with its covariance and what it
    tells of the calibration.
    """

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PhotometricMotionEstimation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PhotometricMotionEstimationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    reference : ndarray of uint8, shape (r,c)
        Left grey image of the reference pair.
    disparity : ndarray of float32, shape (r,c)
        Disparity of each pixel of the reference, pixels; NaN where none.
    left : ndarray of uint8, shape (r,c)
        Left grey image of the current pair.
    right : ndarray of uint8, shape (r,c)
        Right grey image of the current pair.
    camera_matrix : ndarray of float64, shape (3,3)
        Intrinsic matrix of the rectified left camera, pixels.
    baseline : float
        Distance between the cameras, metres.
    guess : ndarray of float64, shape (4,4)
        Initial T_reference_current.
    calibration : ndarray of float64, shape (k), optional
        Prior estimate of offset and decentring of the disparities, pixels, as RectificationRefinement
        defines them; default: exact.
    calibration_covariance : ndarray of float64, shape (k,k), optional
        Covariance of the prior, square pixels.
    left_mask : ndarray of bool, shape (r,c), optional
        Usable pixels of the left current image; default: all.
    right_mask : ndarray of bool, shape (r,c), optional
        Usable pixels of the right current image; default: all.
    """

    ARRAYS = ArrayPorts(
        {
            "reference": "uint8[r,c]",
            "disparity": "float32[r,c]",
            "left": "uint8[r,c]",
            "right": "uint8[r,c]",
            "camera_matrix": "float64[3,3]",
            "guess": "float64[4,4]",
            "calibration": "float64[k]",
            "calibration_covariance": "float64[k,k]",
            "left_mask": "bool[r,c]",
            "right_mask": "bool[r,c]",
        },
        optional=["calibration", "calibration_covariance", "left_mask", "right_mask"],
    )

    reference: NDArray[np.uint8]
    disparity: NDArray[np.float32]
    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    camera_matrix: NDArray[np.float64]
    baseline: float
    guess: NDArray[np.float64]
    calibration: NDArray[np.float64] | None = None
    calibration_covariance: NDArray[np.float64] | None = None
    left_mask: NDArray[np.bool_] | None = None
    right_mask: NDArray[np.bool_] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PhotometricMotionEstimationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    motion : ndarray of float64, shape (4,4)
        T_reference_current, metres.
    covariance : ndarray of float64, shape (6,6)
        Covariance of the motion, [x y z rx ry rz], perturbation in the reference frame: noise and errors
        common to all pixels.
    noise_covariance : ndarray of float64, shape (6,6)
        Part of the covariance due to the noise of these pairs, from the scatter of the gradient between
        blocks of the image.
    common_response : ndarray of float64, shape (6,14)
        Effect on the motion, [x y z rx ry rz], of one standard deviation of each error common to all
        pixels, in the order of StereoMotionEstimation; column 2 is an offset of the reference disparities.
    calibration : ndarray of float64, shape (k)
        Offset and decentring after this pair, pixels.
    calibration_covariance : ndarray of float64, shape (k,k)
        Covariance of offset and decentring after this pair, square pixels.
    calibration_response : ndarray of float64, shape (6,k)
        Derivatives of the motion by offset and decentring, per pixel.
    pixels : int
        Pixels of the reference that were selected on the finest level.
    overlap : float
        Fraction of them that lie inside the left current image.
    correlation : float
        Correlation of the normalised grey levels with those of the left current image.
    correlation_right : float
        Correlation with the right current image.
    inlier_fraction : float
        Fraction of the pixels in view with a robust weight above one half.
    moved : float
        Median displacement of the pixels in view from the reference to the left current image, pixels.
    conditioning : float
        Ratio of the largest to the smallest eigenvalue of the normal matrix, with rotations scaled by the
        effective distance of the points.
    """

    motion: NDArray[np.float64]
    covariance: NDArray[np.float64]
    noise_covariance: NDArray[np.float64]
    common_response: NDArray[np.float64]
    calibration: NDArray[np.float64]
    calibration_covariance: NDArray[np.float64]
    calibration_response: NDArray[np.float64]
    pixels: int
    overlap: float
    correlation: float
    correlation_right: float
    inlier_fraction: float
    moved: float
    conditioning: float


class PhotometricMotionEstimationInterface(
    Dfn[ConfigT, PhotometricMotionEstimationInputs, PhotometricMotionEstimationOutputs]
):
    """Estimate the motion between two rectified stereo pairs from the grey levels of both current
    images and the dense disparities of the reference, with its covariance.
    """


#: Short names for the implementations.
Inputs = PhotometricMotionEstimationInputs
Outputs = PhotometricMotionEstimationOutputs
Interface = PhotometricMotionEstimationInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesPrediction2D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesPrediction2DInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points in the reference camera's frame, metres.
    pose : ndarray of float64, shape (4,4)
        T_current_reference, the predicted motion of the camera.
    camera_matrix : ndarray of float64, shape (3,3)
        Camera matrix of the rectified left camera, pixels.
    baseline : float
        Distance between the cameras, metres.
    image : ndarray of uint8, shape (r,c)
        Image in which the points are predicted; only its size is used.
    slopes : ndarray of float64, shape (n,2), optional
        Derivatives of the disparity by column and row in the reference image; default: 0, surfaces parallel
        to the image.
    """

    ARRAYS = ArrayPorts(
        {
            "points": "float64[n,3]",
            "pose": "float64[4,4]",
            "camera_matrix": "float64[3,3]",
            "image": "uint8[r,c]",
            "slopes": "float64[n,2]",
        },
        optional=["slopes"],
    )

    points: NDArray[np.float64]
    pose: NDArray[np.float64]
    camera_matrix: NDArray[np.float64]
    baseline: float
    image: NDArray[np.uint8]
    slopes: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesPrediction2DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    features : ndarray of float64, shape (n,2)
        Predicted column and row, pixels.
    disparities : ndarray of float64, shape (n)
        Predicted disparity, pixels.
    warps : ndarray of float64, shape (n,3,3)
        Homographies from offsets around each point in the reference image to offsets around the predicted
        one, pixels.
    slopes : ndarray of float64, shape (n,2)
        Derivatives of the disparity by column and row in the predicted image.
    visible : ndarray of bool, shape (n)
        True for points in front of the camera, inside the image, and within the limit on magnification.
    """

    features: NDArray[np.float64]
    disparities: NDArray[np.float64]
    warps: NDArray[np.float64]
    slopes: NDArray[np.float64]
    visible: NDArray[np.bool_]


class FeaturesPrediction2DInterface(Dfn[ConfigT, FeaturesPrediction2DInputs, FeaturesPrediction2DOutputs]):
    """Predict the positions of known points in both images of a rectified pair at a predicted pose,
    and the warps of their patches.
    """


#: Short names for the implementations.
Inputs = FeaturesPrediction2DInputs
Outputs = FeaturesPrediction2DOutputs
Interface = FeaturesPrediction2DInterface

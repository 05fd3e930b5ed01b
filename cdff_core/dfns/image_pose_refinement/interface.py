# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ImagePoseRefinement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImagePoseRefinementInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of uint8, shape (h,w)
        Grey image without lens distortion.
    camera_matrix : ndarray of float64, shape (3,3)
        Camera matrix, pixels; (0, 0) is the centre of the first pixel.
    pose : ndarray of float64, shape (4,4)
        Predicted T_camera_model.
    covariance : ndarray of float64, shape (6,6)
        Covariance of the prediction: x y z, m2, and rx ry rz, rad2, in the axes of the camera.
    vertices : ndarray of float64, shape (n,3)
        Vertices of the visible mesh, metres, by ModelPreparation.
    triangles : ndarray of int64, shape (m,3)
        Triangles of the visible mesh.
    centre_m : ndarray of float64, shape (3)
        Centre of the body, metres.
    diameter_m : float
        Largest extent of the body, metres.
    """

    ARRAYS = ArrayPorts(
        {
            "image": "uint8[h,w]",
            "camera_matrix": "float64[3,3]",
            "pose": "float64[4,4]",
            "covariance": "float64[6,6]",
            "vertices": "float64[n,3]",
            "triangles": "int64[m,3]",
            "centre_m": "float64[3]",
        },
        finite=["camera_matrix", "pose", "covariance"],
        positive=["diameter_m"],
    )

    image: NDArray[np.uint8]
    camera_matrix: NDArray[np.float64]
    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    centre_m: NDArray[np.float64]
    diameter_m: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImagePoseRefinementOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pose : ndarray of float64, shape (4,4)
        Mean T_camera_model, given the image and the prediction.
    covariance : ndarray of float64, shape (6,6)
        Covariance of this pose, given the image and the prediction, as that of the prediction.
    correlation : float
        Correlation of the edges of image and rendering, -1 to 1.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    correlation: float


class ImagePoseRefinementInterface(Dfn[ConfigT, ImagePoseRefinementInputs, ImagePoseRefinementOutputs]):
    """Refine the predicted pose of a known body in one image by the edges inside its outline, for
    light in which single edges cannot be assigned to the mesh.
    """


#: Short names for the implementations.
Inputs = ImagePoseRefinementInputs
Outputs = ImagePoseRefinementOutputs
Interface = ImagePoseRefinementInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ImagePoseSearch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImagePoseSearchInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of uint8, shape (h,w)
        Grey image without lens distortion.
    camera_matrix : ndarray of float64, shape (3,3)
        Camera matrix, pixels; (0, 0) is the centre of the first pixel.
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
            "vertices": "float64[n,3]",
            "triangles": "int64[m,3]",
            "centre_m": "float64[3]",
        },
        finite=["camera_matrix"],
        positive=["diameter_m"],
    )

    image: NDArray[np.uint8]
    camera_matrix: NDArray[np.float64]
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    centre_m: NDArray[np.float64]
    diameter_m: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImagePoseSearchOutputs:
    """Outputs of one call.

    Attributes
    ----------
    poses : ndarray of float64, shape (k,4,4)
        Distinct poses T_camera_model, best first.
    scores : ndarray of float64, shape (k)
        Agreement of image and rendering, 0 to 3.5.
    agreements : ndarray of float64, shape (k,3)
        Correlation of the edges, part of the light inside the outline, part of the variance of the light
        that the normals explain.
    light : ndarray of float64, shape (3)
        Column and row of the centre of the light of the body, and its extent, pixels.
    """

    poses: NDArray[np.float64]
    scores: NDArray[np.float64]
    agreements: NDArray[np.float64]
    light: NDArray[np.float64]


class ImagePoseSearchInterface(Dfn[ConfigT, ImagePoseSearchInputs, ImagePoseSearchOutputs]):
    """Search for the pose of a known body in one image with a dark background, without a guess, by
    comparison of its light and edges with renderings of all its sides.
    """


#: Short names for the implementations.
Inputs = ImagePoseSearchInputs
Outputs = ImagePoseSearchOutputs
Interface = ImagePoseSearchInterface

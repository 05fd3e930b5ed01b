# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN SurfaceFusion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SurfaceFusionInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float32, shape (r,c,3)
        Points in the frame of the camera, metres, arranged by the pixels of cameraMatrix; NaN for pixels
        without a point; an image of zero rows adds nothing.
    normals : ndarray of float32, shape (r,c,3)
        Unit normals towards the camera; NaN excludes the pixel.
    sigmas : ndarray of float32, shape (r,c)
        Standard deviations of the points along their rays, metres, above 0.
    colors : ndarray of uint8, shape (r,c,3), optional
        Red, green, blue; absent without colour.
    camera_matrix : ndarray of float64, shape (3,3)
        Camera matrix, px.
    pose : ndarray of float64, shape (4,4)
        T_model_camera.
    is_extracted : bool
        True to return the surface after the addition.
    """

    ARRAYS = ArrayPorts(
        {
            "points": "float32[r,c,3]",
            "normals": "float32[r,c,3]",
            "sigmas": "float32[r,c]",
            "colors": "uint8[r,c,3]",
            "camera_matrix": "float64[3,3]",
            "pose": "float64[4,4]",
        },
        optional=["colors"],
    )

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    sigmas: NDArray[np.float32]
    camera_matrix: NDArray[np.float64]
    pose: NDArray[np.float64]
    is_extracted: bool
    colors: NDArray[np.uint8] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SurfaceFusionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    blocks : int
        Number of blocks of 8 x 8 x 8 voxels.
    rejected_blocks : int
        Number of blocks of this image that max_blocks excluded.
    vertices : ndarray of float64, shape (v,3)
        Vertices, metres; none if not extracted.
    triangles : ndarray of int64, shape (t,3)
        Triangles, counter-clockwise seen from outside.
    vertex_normals : ndarray of float64, shape (v,3)
        Unit normals, outwards.
    vertex_colors : ndarray of uint8, shape (v,3)
        Red, green, blue; zero where no image had colour.
    vertex_sigmas : ndarray of float64, shape (v)
        Standard deviations along the normals, metres: from the stated noise or from the scatter of the
        views, whichever is larger.
    vertex_views : ndarray of int64, shape (v)
        Number of images that observed the vertex.
    """

    blocks: int
    rejected_blocks: int
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    vertex_normals: NDArray[np.float64]
    vertex_colors: NDArray[np.uint8]
    vertex_sigmas: NDArray[np.float64]
    vertex_views: NDArray[np.int64]


class SurfaceFusionInterface(Dfn[ConfigT, SurfaceFusionInputs, SurfaceFusionOutputs]):
    """Fuse organised clouds of known pose into a surface with colour, standard deviation and number of
    views, and extract it as a triangle mesh.
    """


#: Short names for the implementations.
Inputs = SurfaceFusionInputs
Outputs = SurfaceFusionOutputs
Interface = SurfaceFusionInterface

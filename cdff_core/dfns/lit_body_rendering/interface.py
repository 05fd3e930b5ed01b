# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN LitBodyRendering."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LitBodyRenderingInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of uint8, shape (r,c)
        Grey image of the body, without lens distortion, whose size and grey levels the rendering has.
    camera_matrix : ndarray of float64, shape (3,3)
        Camera matrix, px; (0, 0) is the centre of the first pixel.
    pose : ndarray of float64, shape (4,4)
        T_camera_model.
    vertices : ndarray of float64, shape (v,3)
        Vertices of the visible mesh, metres.
    triangles : ndarray of int64, shape (t,3)
        Triangles of the visible mesh.
    sun : ndarray of float64, shape (3)
        Direction to the Sun in the frame of the camera.
    """

    ARRAYS = ArrayPorts(
        {
            "image": "uint8[r,c]",
            "camera_matrix": "float64[3,3]",
            "pose": "float64[4,4]",
            "vertices": "float64[v,3]",
            "triangles": "int64[t,3]",
            "sun": "float64[3]",
        },
        finite=["sun"],
    )

    image: NDArray[np.uint8]
    camera_matrix: NDArray[np.float64]
    pose: NDArray[np.float64]
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    sun: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LitBodyRenderingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    rendering : ndarray of uint8, shape (r,c)
        Rendered image.
    depth : ndarray of float64, shape (r,c)
        Depth along the optical axis, metres; infinite where there is no body.
    lit_pixels : int
        Number of pixels of the body in the light.
    correlation : float
        Correlation of image and rendering on the body; NaN if one of them is constant there.
    """

    rendering: NDArray[np.uint8]
    depth: NDArray[np.float64]
    lit_pixels: int
    correlation: float


class LitBodyRenderingInterface(Dfn[ConfigT, LitBodyRenderingInputs, LitBodyRenderingOutputs]):
    """Render a known body as a camera sees it in the light of the Sun, with the shadows that it casts
    on itself, with the grey levels of an image of it.
    """


#: Short names for the implementations.
Inputs = LitBodyRenderingInputs
Outputs = LitBodyRenderingOutputs
Interface = LitBodyRenderingInterface

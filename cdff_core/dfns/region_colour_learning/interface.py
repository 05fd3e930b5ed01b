# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN RegionColourLearning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RegionColourLearningInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of uint8, shape (r,c,d)
        Image of one or three channels, without lens distortion.
    camera_matrix : ndarray of float64, shape (3,3)
        Camera matrix, px; (0, 0) is the centre of the first pixel.
    pose : ndarray of float64, shape (4,4)
        T_camera_model.
    vertices : ndarray of float64, shape (v,3)
        Vertices of the visible mesh, metres.
    triangles : ndarray of int64, shape (t,3)
        Triangles of the visible mesh.
    body_colours : ndarray of float64, shape (b), optional
        Frequencies of the colours of the body so far.
    background_colours : ndarray of float64, shape (b), optional
        Frequencies of the colours next to the body so far.
    """

    ARRAYS = ArrayPorts(
        {
            "image": "uint8[r,c,d]",
            "camera_matrix": "float64[3,3]",
            "pose": "float64[4,4]",
            "vertices": "float64[v,3]",
            "triangles": "int64[t,3]",
            "body_colours": "float64[b]",
            "background_colours": "float64[b]",
        },
        finite=["body_colours", "background_colours"],
        optional=["body_colours", "background_colours"],
    )

    image: NDArray[np.uint8]
    camera_matrix: NDArray[np.float64]
    pose: NDArray[np.float64]
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    body_colours: NDArray[np.float64] | None = None
    background_colours: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RegionColourLearningOutputs:
    """Outputs of one call.

    Attributes
    ----------
    body_colours : ndarray of float64, shape (b)
        Frequencies of the colours of the body: bins of the first channel, of the second, of the third; all
        0 before any pixel was seen.
    background_colours : ndarray of float64, shape (b)
        Frequencies of the colours next to the body; all 0 before any pixel was seen.
    pixels : int
        Number of pixels of the body.
    """

    body_colours: NDArray[np.float64]
    background_colours: NDArray[np.float64]
    pixels: int


class RegionColourLearningInterface(Dfn[ConfigT, RegionColourLearningInputs, RegionColourLearningOutputs]):
    """Learn the colours of a known body and of the background next to it from an image and the pose of
    the body.
    """


#: Short names for the implementations.
Inputs = RegionColourLearningInputs
Outputs = RegionColourLearningOutputs
Interface = RegionColourLearningInterface

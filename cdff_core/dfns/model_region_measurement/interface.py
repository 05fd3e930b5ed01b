# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ModelRegionMeasurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelRegionMeasurementInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of uint8, shape (r,c,d)
        Image of one or three channels, without lens distortion.
    camera_matrix : ndarray of float64, shape (3,3)
        Camera matrix, px; (0, 0) is the centre of the first pixel.
    pose : ndarray of float64, shape (4,4)
        T_camera_model at which the outline is drawn.
    vertices : ndarray of float64, shape (v,3)
        Vertices of the visible mesh, metres.
    triangles : ndarray of int64, shape (t,3)
        Triangles of the visible mesh.
    body_colours : ndarray of float64, shape (b)
        Frequencies of the colours of the body: bins of the first channel, of the second, of the third.
    background_colours : ndarray of float64, shape (b)
        Frequencies of the colours next to the body.
    range_px : float
        Largest offset of the outline, px.
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
        positive=["range_px"],
    )

    image: NDArray[np.uint8]
    camera_matrix: NDArray[np.float64]
    pose: NDArray[np.float64]
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    body_colours: NDArray[np.float64]
    background_colours: NDArray[np.float64]
    range_px: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelRegionMeasurementOutputs:
    """Outputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points of the outline in the frame of the model, metres.
    pixels : ndarray of float64, shape (n,2)
        Column and row of the points at the pose.
    normals : ndarray of float64, shape (n,2)
        Unit normals of the outline in the image, away from the body.
    offsets : ndarray of float64, shape (n,1)
        Mean offset of the outline along the normal, px.
    sigmas : ndarray of float64, shape (n)
        Standard deviation of each offset, px.
    """

    points: NDArray[np.float64]
    pixels: NDArray[np.float64]
    normals: NDArray[np.float64]
    offsets: NDArray[np.float64]
    sigmas: NDArray[np.float64]


class ModelRegionMeasurementInterface(
    Dfn[ConfigT, ModelRegionMeasurementInputs, ModelRegionMeasurementOutputs]
):
    """Measure where the outline of a known body is in an image from the colours of the body and of its
    background: for points of the outline at a pose, the offset along the normal that separates the
    colours best.
    """


#: Short names for the implementations.
Inputs = ModelRegionMeasurementInputs
Outputs = ModelRegionMeasurementOutputs
Interface = ModelRegionMeasurementInterface

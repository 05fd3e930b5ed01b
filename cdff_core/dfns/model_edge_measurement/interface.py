# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ModelEdgeMeasurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelEdgeMeasurementInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of float32, shape (r,c)
        Grey image without lens distortion.
    camera_matrix : ndarray of float64, shape (3,3)
        Camera matrix, px; (0, 0) is the centre of the first pixel.
    pose : ndarray of float64, shape (4,4)
        T_camera_model at which the edges are drawn.
    vertices : ndarray of float64, shape (v,3)
        Vertices of the visible mesh, metres.
    triangles : ndarray of int64, shape (t,3)
        Triangles of the visible mesh.
    range_px : float
        Largest offset of an image edge, px.
    """

    ARRAYS = ArrayPorts(
        {
            "image": "float32[r,c]",
            "camera_matrix": "float64[3,3]",
            "pose": "float64[4,4]",
            "vertices": "float64[v,3]",
            "triangles": "int64[t,3]",
        },
        finite=["image"],
        positive=["range_px"],
    )

    image: NDArray[np.float32]
    camera_matrix: NDArray[np.float64]
    pose: NDArray[np.float64]
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    range_px: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelEdgeMeasurementOutputs:
    """Outputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Control points in the frame of the model, metres.
    pixels : ndarray of float64, shape (n,2)
        Column and row of the control points at the pose.
    normals : ndarray of float64, shape (n,2)
        Unit normals of the edges of the body in the image.
    offsets : ndarray of float64, shape (n,h)
        Offsets along the normal from the control point to up to h image edges, strongest first, px; NaN if
        there are fewer.
    """

    points: NDArray[np.float64]
    pixels: NDArray[np.float64]
    normals: NDArray[np.float64]
    offsets: NDArray[np.float64]


class ModelEdgeMeasurementInterface(Dfn[ConfigT, ModelEdgeMeasurementInputs, ModelEdgeMeasurementOutputs]):
    """Measure how far the edges in an image are from the visible edges of a known body at a pose.
    Control points are selected on the outline and the creases of the body. For each control point,
    the DFN searches the image along the normal of the body's edge, and returns the offsets of the
    image edges that it finds.
    """


#: Short names for the implementations.
Inputs = ModelEdgeMeasurementInputs
Outputs = ModelEdgeMeasurementOutputs
Interface = ModelEdgeMeasurementInterface

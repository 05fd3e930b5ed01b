# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ModelPreparation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelPreparationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    vertices : ndarray of float64, shape (n,3)
        Vertices in the frame of the model, metres.
    triangles : ndarray of int64, shape (m,3)
        Rows of the vertices of each triangle.
    """

    ARRAYS = ArrayPorts({"vertices": "float64[n,3]", "triangles": "int64[m,3]"})

    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelPreparationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    drawn_vertices : ndarray of float64, shape (v,3)
        Vertices of the visible mesh, metres.
    drawn_triangles : ndarray of int64, shape (t,3)
        Triangles of the visible mesh, decimated above max_triangles.
    points : ndarray of float64, shape (p,3)
        Evenly spread points of the visible surface, metres.
    normals : ndarray of float64, shape (p,3)
        Outward unit normals of the points.
    grid_index : ndarray of int32, shape (a,b,c)
        Row of the point that is nearest to the centre of each cell.
    grid_low : ndarray of float64, shape (3)
        Corner of the first cell, metres.
    grid_cell_m : float
        Edge of a cell, metres.
    view_directions : ndarray of float64, shape (d,3)
        Directions from the model to viewers on all sides.
    view_centroids : ndarray of float64, shape (d,3)
        Mean of the points that are visible from each direction, metres.
    symmetries : ndarray of float64, shape (s,4,4)
        Transforms of the model that leave its surface unchanged, the identity first; a continuous symmetry
        is sampled every 10 degrees.
    centre_m : ndarray of float64, shape (3)
        Centre of the box around the surface, metres.
    diameter_m : float
        Largest extent, metres.
    """

    drawn_vertices: NDArray[np.float64]
    drawn_triangles: NDArray[np.int64]
    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    grid_index: NDArray[np.int32]
    grid_low: NDArray[np.float64]
    grid_cell_m: float
    view_directions: NDArray[np.float64]
    view_centroids: NDArray[np.float64]
    symmetries: NDArray[np.float64]
    centre_m: NDArray[np.float64]
    diameter_m: float


class ModelPreparationInterface(Dfn[ConfigT, ModelPreparationInputs, ModelPreparationOutputs]):
    """Prepare the mesh of a known body for detection and tracking: the surface that is visible from
    outside as points with outward normals, a grid of its nearest points, the visible triangles for
    rendering, and the rotational symmetry.
    """


#: Short names for the implementations.
Inputs = ModelPreparationInputs
Outputs = ModelPreparationOutputs
Interface = ModelPreparationInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A model that is prepared for detection and tracking."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import StrictModel
from cdff_core.object_models.decimation import decimate
from cdff_core.object_models.nearest_grid import NearestGrid, nearest_grid
from cdff_core.object_models.surface import VisibleSurface, visible_surface
from cdff_core.object_models.symmetry import SymmetryGroup, symmetry_group

#: Number of pixels of all views for each triangle, above which a mesh is decimated before its visible surface
#: is determined.
_PIXELS_PER_TRIANGLE = 20


class PreparationConfig(StrictModel):
    """Parameters of the preparation of a model."""

    points: int = Field(
        18_000, ge=1000, le=200_000, description="Approximate number of points of the visible surface"
    )
    views: int = Field(120, ge=60, le=1000, description="Number of views that determine the visible surface")
    view_pixels: int = Field(256, ge=64, le=2048, description="Number of pixels of a side of a view")
    max_triangles: int = Field(
        20_000,
        ge=100,
        le=1_000_000,
        description="Visible triangles above which the rendered mesh is decimated",
    )
    grid_cells: int = Field(
        96, ge=16, le=256, description="Cells of the nearest-point grid along the longest side"
    )
    symmetry_tolerance: float = Field(
        0.01,
        gt=0,
        le=0.1,
        description="Distance up to which a rotated surface is the same, relative to the diameter",
    )


@dataclass(frozen=True, slots=True, eq=False)
class ObjectModel:
    """Model of a body in its own frame, metres.

    Attributes
    ----------
    vertices_m, triangles : ndarray, shapes (n, 3), (m, 3)
        Visible mesh, decimated if it is large; for rendering.
    surface : VisibleSurface
    grid : NearestGrid
        Of the points of the surface.
    symmetry : SymmetryGroup
    """

    vertices_m: FloatArray
    triangles: IntArray
    surface: VisibleSurface
    grid: NearestGrid
    symmetry: SymmetryGroup

    @property
    def diameter_m(self) -> float:
        """Largest extent, metres."""
        return self.surface.diameter_m

    @property
    def size_m(self) -> FloatArray:
        """Extent (3,) along the axes of the model, metres."""
        return np.asarray(np.ptp(self.surface.points_m, axis=0))


def prepare_model(
    vertices_m: FloatArray, triangles: IntArray, config: PreparationConfig, seed: int = 0
) -> ObjectModel:
    """Return the prepared model of a mesh with vertices (n, 3), metres, and triangles (m, 3).

    Raises
    ------
    InputError
        If the mesh has no triangle or is not finite.
    DegenerateGeometryError
        If it has no extent.
    """
    if not len(triangles):
        raise InputError(f"model: {len(vertices_m)} vertices and no triangle, expected a mesh")
    v, t = np.ascontiguousarray(vertices_m, np.float64), np.ascontiguousarray(triangles, np.int64)
    if t.min() < 0 or t.max() >= len(v):
        wrong = int(t.min()) if t.min() < 0 else int(t.max())
        raise InputError(f"model: a triangle has the vertex {wrong}, expected 0 to {len(v) - 1}")
    if not np.isfinite(v[t]).all():
        raise InputError("model: a vertex is NaN or infinite, expected finite coordinates")
    # Of smaller triangles, many would be in no pixel of any view.
    v, t, _ = decimate(v, t, config.views * config.view_pixels**2 // _PIXELS_PER_TRIANGLE)
    surface = visible_surface(
        v, t, points=config.points, views=config.views, pixels=config.view_pixels, seed=seed
    )
    drawn_vertices, drawn_triangles, _ = decimate(v, surface.triangles, config.max_triangles)
    grid = nearest_grid(surface.points_m, config.grid_cells)
    symmetry = symmetry_group(surface, grid, config.symmetry_tolerance)
    return ObjectModel(drawn_vertices, drawn_triangles, surface, grid, symmetry)


def content_hash(vertices_m: FloatArray, triangles: IntArray) -> str:
    """Return the SHA-256 of a mesh, the key of the cache of prepared models."""
    digest = hashlib.sha256(np.ascontiguousarray(vertices_m, np.float64).tobytes())
    digest.update(np.ascontiguousarray(triangles, np.int64).tobytes())
    return digest.hexdigest()

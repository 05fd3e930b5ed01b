# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fusion of images into a truncated signed distance field in sparse blocks of voxels.

Curless, B. and Levoy, M. (1996), "A volumetric method for building complex models from range images",
doi:10.1145/237170.237269. The distance of a voxel is that from the plane of its pixel instead of that along
the ray, which is wrong at oblique incidence and with few pixels. Gibson, S. (1998), "Constrained elastic
surface nets", doi:10.1007/BFb0056277: one vertex in each crossed cell.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from pydantic import Field
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.surface_fusion._blocks import SIDE, VoxelBlocks, is_representable
from cdff_core.dfns.surface_fusion._kernels import (
    disagreement,
    integrate,
    surface_triangles,
    surface_vertices,
)
from cdff_core.dfns.surface_fusion.interface import Inputs, Interface, Outputs

#: Number of pixels above which only every second row and column is used to select the blocks.
_DENSE_PIXELS = 100_000


class TruncatedSignedDistanceConfig(DfnConfig):
    """Parameters of TruncatedSignedDistance."""

    voxel_m: float = Field(0.01, gt=0, le=1e5, description="Edge of a voxel, m")
    truncation_voxels: float = Field(
        4.0, ge=1.5, le=16, description="Distance from the surface up to which voxels are updated, in voxels"
    )
    min_cosine: float = Field(
        0.4, gt=0, le=1, description="Cosine of the angle of incidence below which a pixel is not used"
    )
    min_views: int = Field(2, ge=1, le=1000, description="Images that must have observed an extracted vertex")
    min_part: float = Field(
        0.01,
        ge=0,
        le=1,
        description="Share of the vertices below which a separate part is removed",
    )
    max_disagreement: float = Field(
        0.5, gt=0, le=1, description="Part of the compared voxels that an image may contradict"
    )
    min_compared: int = Field(
        200, ge=1, le=1_000_000, description="Voxels near the surface from which an image is compared with it"
    )
    max_blocks: int = Field(
        50_000, ge=64, le=1_000_000, description="Limit of the number of blocks; a block takes 15 kB"
    )


class TruncatedSignedDistance(Interface[TruncatedSignedDistanceConfig]):
    """Mean distance from the planes of the pixels; weight: squared cosine of incidence by variance."""

    def setup(self) -> None:
        """Clear the voxels."""
        self._blocks = VoxelBlocks(self.config.max_blocks)

    def process(self, inputs: Inputs) -> Outputs:
        """Add an image; return the surface if it is asked for.

        Raises
        ------
        InputError
            If the pose is no rigid transform, or the points lie too far from the origin for the voxels.
        RefusedError
            If the image contradicts the surface; it is then not added.
        """
        if not se3.is_transform(inputs.pose):
            raise InputError("pose: expected a rigid transform")
        rejected = self._add(inputs)
        vertices, triangles = self._surface() if inputs.is_extracted else (np.zeros((0, 8)), _no_triangles())
        return Outputs(
            blocks=len(self._blocks),
            rejected_blocks=rejected,
            vertices=vertices[:, :3].copy(),
            triangles=triangles,
            vertex_normals=_normals(vertices[:, :3], triangles),
            vertex_colors=vertices[:, 3:6].round().astype(np.uint8),
            vertex_sigmas=vertices[:, 6].copy(),
            vertex_views=vertices[:, 7].astype(np.int64),
        )

    def _add(self, inputs: Inputs) -> int:
        """Add an image; return the number of blocks beyond the limit."""
        config, blocks = self.config, self._blocks
        truncation_m = config.truncation_voxels * config.voxel_m
        step = 2 if inputs.sigmas.size > _DENSE_PIXELS else 1
        points = inputs.points[::step, ::step].reshape(-1, 3).astype(np.float64)
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            return 0
        rays = points / np.linalg.norm(points, axis=1, keepdims=True)
        reach = np.arange(-truncation_m, truncation_m + config.voxel_m, 0.5 * SIDE * config.voxel_m)
        samples = (points[:, None] + reach[:, None] * rays[:, None]).reshape(-1, 3)
        samples = samples @ inputs.pose[:3, :3].T + inputs.pose[:3, 3]
        coordinates = np.floor(samples / (SIDE * config.voxel_m))
        if not is_representable(coordinates):
            raise InputError(
                f"points up to {np.abs(samples).max():.3g} m from the origin: too far for voxels of "
                f"{config.voxel_m:g} m, expected larger voxels or a nearer origin"
            )
        T = np.ascontiguousarray(se3.inverse(inputs.pose))
        compared, contradicted = disagreement(
            *blocks.all(),
            config.voxel_m,
            truncation_m,
            config.min_cosine,
            T,
            inputs.camera_matrix,
            inputs.points,
            inputs.normals,
            blocks.distances,
            blocks.views,
        )
        if compared >= config.min_compared and contradicted > config.max_disagreement * compared:
            part = contradicted / compared
            raise RefusedError(
                f"{part:.2f} of {compared} voxels contradict the surface, expected at most "
                f"{config.max_disagreement:g}: the pose or the points are wrong",
                reasons=[f"contradicts_surface:{part:.2f}"],
            )
        stored, slots, rejected = blocks.add(coordinates.astype(np.int64))
        integrate(
            stored,
            slots,
            config.voxel_m,
            truncation_m,
            config.min_cosine,
            T,
            inputs.camera_matrix,
            inputs.points,
            inputs.normals,
            inputs.sigmas,
            np.zeros((0, 0, 3), np.uint8) if inputs.colors is None else inputs.colors,
            blocks.distances,
            blocks.weights,
            blocks.scatters,
            blocks.views,
            blocks.colors,
        )
        return rejected

    def _surface(self) -> tuple[FloatArray, IntArray]:
        """Return vertices ``(v, 8)`` and triangles of all parts of the surface that are large enough."""
        blocks = self._blocks
        coordinates, around = blocks.neighbours()
        cells = np.empty(blocks.weights.shape, np.int64)
        vertices = surface_vertices(
            coordinates,
            around,
            self.config.voxel_m,
            self.config.min_views,
            blocks.distances,
            blocks.weights,
            blocks.scatters,
            blocks.views,
            blocks.colors,
            cells,
        )
        triangles = surface_triangles(around, blocks.distances, cells)
        return _large_parts(vertices, triangles, self.config.min_part)


@cache
def compile_kernels() -> None:
    """Fuse and extract a plane, once in this process: the first image takes no longer than the others."""
    columns, rows = np.meshgrid(np.arange(16.0), np.arange(16.0))
    points = np.stack([columns - 8.0, rows - 8.0, np.full_like(rows, 10.0)], axis=2).astype(np.float32)
    fusion = TruncatedSignedDistance()
    fusion.configure({"voxel_m": 1.0, "min_views": 1, "max_blocks": 64})
    fusion.process(
        Inputs(
            points=points,
            normals=np.full_like(points, [0.0, 0.0, -1.0]),
            sigmas=np.ones(rows.shape, np.float32),
            camera_matrix=np.array([[10.0, 0.0, 8.0], [0.0, 10.0, 8.0], [0.0, 0.0, 1.0]]),
            pose=np.eye(4),
            is_extracted=True,
        )
    )


def _no_triangles() -> IntArray:
    return np.zeros((0, 3), np.int64)


def _large_parts(vertices: FloatArray, triangles: IntArray, min_part: float) -> tuple[FloatArray, IntArray]:
    """Return the mesh without small separate parts and unused vertices."""
    n = len(vertices)
    if not len(triangles):
        return vertices[:0], triangles
    edge_vertices = triangles[:, [0, 1, 2]].ravel(), triangles[:, [1, 2, 0]].ravel()
    graph = coo_array((np.ones(len(edge_vertices[0]), bool), edge_vertices), shape=(n, n))
    _, labels = connected_components(graph, directed=False)
    sizes = np.bincount(labels)
    is_kept = sizes[labels] >= max(3.0, min_part * n)
    triangles = triangles[is_kept[triangles[:, 0]]]
    return vertices[is_kept], (np.cumsum(is_kept) - 1)[triangles]


def _normals(vertices: FloatArray, triangles: IntArray) -> FloatArray:
    """Return the normals of vertices: of the triangles around each, weighted by their areas."""
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    faces = np.cross(b - a, c - a)
    sums = np.stack(
        [
            sum(
                (np.bincount(triangles[:, corner], faces[:, axis], len(vertices)) for corner in range(3)),
                np.zeros(len(vertices)),
            )
            for axis in range(3)
        ],
        axis=1,
    )
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-300))

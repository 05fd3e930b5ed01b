# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Map of points in tiles, and the local map around a position."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.voxels import voxel_means
from cdff_core.dfpcs.lidar_localisation.surface import Surface

Float = NDArray[np.float64]

#: Edge of a tile; distance from the centre of a local map up to which it is reused, metres.
_TILE_M, _REUSE_M = 10.0, 3.0


class LocalMap(Surface):
    """Part of the map with which a sweep is registered.

    ``normals`` computes the normals (n, 3) of points, ``coarse`` thins points for the coarse registration.
    """

    def __init__(
        self, points_m: Float, normals: Callable[[Float], Float], coarse: Callable[[Float], Float]
    ) -> None:
        super().__init__(points_m, normals)
        self._coarse = coarse

    @cached_property
    def coarse(self) -> Surface:
        """The map thinned for the coarse registration."""
        return Surface(self._coarse(self.points_m), self._normals_of)


class _CachedMap(NamedTuple):
    centre_m: Float  # (2,)
    map: LocalMap


class TiledMap:
    """Points in tiles, one mean point per voxel.

    ``normals`` computes the normals (n, 3) of points, ``coarse`` thins points for the coarse registration.
    """

    def __init__(
        self,
        voxel_m: float,
        radius_m: float,
        normals: Callable[[Float], Float],
        coarse: Callable[[Float], Float],
    ) -> None:
        self._voxel_m, self._radius_m = voxel_m, radius_m
        self._normals, self._coarse = normals, coarse
        self._tiles: dict[tuple[int, int], Float] = {}
        self._local: _CachedMap | None = None
        self.frame = ""

    def add(self, points_m: Float, frame: str) -> None:
        """Add points ``(n, 3)``; points in another frame start a new map."""
        if frame != self.frame:
            self.clear()
            self.frame = frame
        self._local = None
        points = points_m[np.isfinite(points_m).all(axis=1)]
        index = np.floor(points[:, :2] / _TILE_M).astype(np.int64)
        order = np.lexsort((index[:, 1], index[:, 0]))
        tiles, starts = np.unique(index[order], axis=0, return_index=True)
        for (x, y), rows in zip(tiles.tolist(), np.split(order, starts[1:]), strict=True):
            existing = self._tiles.get((x, y), np.zeros((0, 3)))
            self._tiles[x, y] = voxel_means(np.vstack([existing, points[rows]]), self._voxel_m)

    def clear(self) -> None:
        """Remove all points."""
        self._tiles, self._local = {}, None

    def __bool__(self) -> bool:
        return bool(self._tiles)

    @property
    def points_m(self) -> Float:
        """All points ``(n, 3)``."""
        return (
            np.vstack([self._tiles[key] for key in sorted(self._tiles)]) if self._tiles else np.zeros((0, 3))
        )

    def around(self, centre_m: Float, radius_m: float) -> Float:
        """Return the points ``(n, 3)`` within a horizontal radius around a position (3,)."""
        low = np.floor((centre_m[:2] - radius_m) / _TILE_M).astype(int)
        high = np.floor((centre_m[:2] + radius_m) / _TILE_M).astype(int)
        inside = [
            self._tiles[x, y]
            for x in range(low[0], high[0] + 1)
            for y in range(low[1], high[1] + 1)
            if (x, y) in self._tiles
        ]
        if not inside:
            return np.zeros((0, 3))
        points: Float = np.vstack(inside)
        is_inside: NDArray[np.bool_] = np.sum((points[:, :2] - centre_m[:2]) ** 2, axis=1) <= radius_m**2
        return points[is_inside]

    def local(self, centre_m: Float, min_points: int) -> LocalMap | None:
        """Return the map around a position, cached; None with fewer than ``min_points`` points."""
        if self._local is None or np.linalg.norm(self._local.centre_m - centre_m[:2]) > _REUSE_M:
            points = self.around(centre_m, self._radius_m + _REUSE_M)
            self._local = _CachedMap(centre_m[:2].copy(), LocalMap(points, self._normals, self._coarse))
        local = self._local.map
        return local if len(local.points_m) >= min_points else None

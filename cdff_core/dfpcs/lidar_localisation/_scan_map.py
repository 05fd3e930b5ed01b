# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The map in tiles, and the part of it around a place."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.voxels import voxel_means

Float = NDArray[np.float64]


class LocalMap:
    """What a sweep is matched with; made as far as it is asked for.

    Attributes
    ----------
    points_m : ndarray, shape (n, 3)

    Parameters
    ----------
    points_m : ndarray
    normals, coarse : callable
        See ``ScanMap``.
    """

    def __init__(self, points_m: Float, normals: Callable[[Float], Float], coarse: Callable[[Float], Float]) -> None:
        self.points_m = points_m
        self._normals, self._coarse = normals, coarse

    @cached_property
    def normals(self) -> Float:
        """Normals ``(n, 3)``."""
        return self._normals(self.points_m)

    @cached_property
    def coarse_m(self) -> Float:
        """The points thinned to be matched from afar ``(k, 3)``."""
        return self._coarse(self.points_m)

    @cached_property
    def coarse_normals(self) -> Float:
        """Normals ``(k, 3)`` of these."""
        return self._normals(self.coarse_m)


class ScanMap:
    """Points in tiles, one mean point a voxel.

    Parameters
    ----------
    voxel_m, tile_m : float
    radius_m, reuse_m : float
        Of the local map, and how far from its middle it still serves.
    normals, coarse : callable
        Normals (n, 3) of points (n, 3); points thinned to be matched from afar.
    """

    def __init__(
        self, voxel_m: float, tile_m: float, radius_m: float, reuse_m: float,
        normals: Callable[[Float], Float], coarse: Callable[[Float], Float],
    ) -> None:  # fmt: skip
        self._voxel_m, self._tile_m, self._radius_m, self._reuse_m = voxel_m, tile_m, radius_m, reuse_m
        self._normals, self._coarse = normals, coarse
        self._tiles: dict[tuple[int, int], Float] = {}
        self._local: tuple[Float, LocalMap | None] | None = None
        self.frame = ""

    def add(self, points_m: Float, frame: str) -> None:
        """Put points ``(n, 3)`` into their tiles; those of another frame begin a new map."""
        if frame != self.frame:
            self.clear()
            self.frame = frame
        self._local = None
        points = points_m[np.isfinite(points_m).all(axis=1)]
        index = np.floor(points[:, :2] / self._tile_m).astype(np.int64)
        order = np.lexsort((index[:, 1], index[:, 0]))
        keys, first = np.unique(index[order], axis=0, return_index=True)
        for (x, y), rows in zip(keys.tolist(), np.split(order, first[1:]), strict=True):
            there = self._tiles.get((x, y))
            both = points[rows] if there is None else np.vstack([there, points[rows]])
            self._tiles[x, y] = voxel_means(both, self._voxel_m)

    def clear(self) -> None:
        """Forget all points."""
        self._tiles, self._local = {}, None

    def __bool__(self) -> bool:
        return bool(self._tiles)

    @property
    def points_m(self) -> Float:
        """All points ``(n, 3)``."""
        return np.vstack([self._tiles[key] for key in sorted(self._tiles)]) if self._tiles else np.zeros((0, 3))

    def around(self, centre_m: Float, radius_m: float) -> Float:
        """Points ``(n, 3)`` whose x and y lie within a radius."""
        low = np.floor((centre_m[:2] - radius_m) / self._tile_m).astype(int)
        high = np.floor((centre_m[:2] + radius_m) / self._tile_m).astype(int)
        inside = [
            self._tiles[x, y]
            for x in range(low[0], high[0] + 1)
            for y in range(low[1], high[1] + 1)
            if (x, y) in self._tiles
        ]
        if not inside:
            return np.zeros((0, 3))
        points = np.vstack(inside)
        return points[np.sum((points[:, :2] - centre_m[:2]) ** 2, axis=1) <= radius_m**2]

    def local(self, centre_m: Float, least: int) -> LocalMap | None:
        """The map around a place; None where it has fewer than ``least`` points. Kept while the place stays near."""
        if self._local is not None and np.linalg.norm(self._local[0] - centre_m[:2]) <= self._reuse_m:
            return self._local[1]
        points = self.around(centre_m, self._radius_m + self._reuse_m)
        made = None
        if len(points) >= least:
            made = LocalMap(points, self._normals, self._coarse)
        self._local = (centre_m[:2].copy(), made)
        return made

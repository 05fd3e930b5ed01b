# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation map of the whole observed area, in tiles."""

from __future__ import annotations

from collections import OrderedDict
from itertools import product

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError
from cdff_common.raster import GridGeometry
from cdff_core.dfns.dem_fusion._configuration import WindowConfig
from cdff_core.dfns.dem_fusion.interface import Inputs, Interface, Outputs
from cdff_core.elevation import visibility
from cdff_core.elevation.map_cells import MapCells
from cdff_core.elevation.patch_fusion import bounds_of, middle_of, window_around

#: Cells along the edge of a tile.
TILE = 128


class TiledMapConfig(WindowConfig):
    """Parameters of TiledMap."""

    max_tiles: int = Field(
        2000, ge=1, description="Maximum number of tiles; the least recently used are evicted"
    )
    max_cells: int = Field(
        1 << 22, ge=1 << 14, description="Maximum number of cells for given bounds; above it cells double"
    )


class TiledMap(Interface[TiledMapConfig]):
    """Pool each patch into tiles of 128 x 128 cells; memory grows with the observed area.

    Above ``max_tiles`` tiles the least recently used ones are evicted and counted in ``forgotten``. A map for
    given bounds has at most ``max_cells`` cells: above, cells are pooled into ones 2^n times as large.
    """

    def setup(self) -> None:
        """Start with an empty map."""
        visibility.compile_now(1.0)
        self._tiles: OrderedDict[tuple[int, int], MapCells] = OrderedDict()
        self._like: GridGeometry | None = None
        self._span_ns = (0, 0)
        self._centre = np.zeros(2)

    @property
    def nbytes(self) -> int:
        """Memory of all tiles, bytes."""
        return sum(tile.nbytes for tile in self._tiles.values())

    def process(self, inputs: Inputs) -> Outputs:
        """Return the window around the centre, or the map of the bounds, after adding the patch.

        Raises
        ------
        InputError
            If the cells of the patch do not fit those of the map, or there is neither a patch nor a map.
        """
        patch, cleared, forgotten = inputs.patch, 0, 0
        if patch is not None:
            new = MapCells.of_map(patch, self.config.resolution_m)
            self._begin(new.geometry, patch.t0_ns, patch.t1_ns)
            if inputs.centre is None:
                self._centre = middle_of(patch.geometry)
            if inputs.rays is not None:
                below_rays = product(*_reached_by(_reach(new.geometry, inputs.rays)))
                for tile in (self._tiles[key] for key in below_rays if key in self._tiles):
                    cleared += visibility.clear_seen_through(
                        tile, inputs.rays, patch.t0_ns, self.config.clear_margin_m
                    )
            for key in product(*_reached_by(new.geometry)):
                forgotten += self._add(key, new)
        if inputs.centre is not None:
            self._centre = np.asarray(inputs.centre, dtype=np.float64)
        wanted = MapCells.empty(self._wanted(inputs.bounds))
        factor = round(wanted.geometry.resolution_m / self._grid.resolution_m)
        rows, cols = _reached_by(wanted.geometry, factor)
        for (i, j), tile in self._tiles.items():
            if i in rows and j in cols:
                wanted.add(tile.coarsened(factor))
        return Outputs(map=wanted.to_map(*self._span_ns), cleared=cleared, forgotten=forgotten)

    @property
    def _grid(self) -> GridGeometry:
        """Return a grid of the map's cells; raises InputError before the first patch."""
        if self._like is None:
            raise InputError("no patch yet: there is no map to return")
        return self._like

    def _begin(self, geometry: GridGeometry, t0_ns: int, t1_ns: int) -> None:
        if self._like is None or not self._like.shares_cells_with(geometry):
            self._tiles.clear()
            self._like, self._span_ns = geometry, (t0_ns, t1_ns)
        self._span_ns = (min(self._span_ns[0], t0_ns), max(self._span_ns[1], t1_ns))

    def _add(self, key: tuple[int, int], new: MapCells) -> int:
        """Pool cells into their tile and return the number of evicted tiles."""
        tile = self._geometry(key)
        part = new.geometry.intersection(tile)
        if part is None or not new.statistics.count[new.geometry.slices_of(part)].any():
            return 0
        if key not in self._tiles:
            self._tiles[key] = MapCells.empty(tile)
        self._tiles[key].add(new)
        self._tiles.move_to_end(key)
        if len(self._tiles) <= self.config.max_tiles:
            return 0
        self._tiles.popitem(last=False)
        return 1

    def _geometry(self, key: tuple[int, int]) -> GridGeometry:
        like, (i, j) = self._grid, key
        return GridGeometry.from_cells(
            like.frame, like.resolution_m, left=j * TILE, top=(i + 1) * TILE, rows=TILE, cols=TILE
        )

    def _wanted(self, bounds: FloatArray | None) -> GridGeometry:
        """Return the grid of the window, or a grid of at most ``max_cells`` cells over the bounds."""
        like = self._grid
        if bounds is None:
            return window_around(like.frame, like.resolution_m, self._centre, self.config.size_m)
        x0, y0, x1, y1 = bounds_of(bounds) if np.all(np.isfinite(bounds)) else self._extent_m()
        cell_m = like.resolution_m
        while ((x1 - x0) / cell_m + 2.0) * ((y1 - y0) / cell_m + 2.0) > self.config.max_cells:
            cell_m *= 2.0
        return GridGeometry.aligned(like.frame, cell_m, (x0, y0, x1, y1))

    def _extent_m(self) -> tuple[float, float, float, float]:
        """Return the bounds of all tiles."""
        each = np.array([tile.geometry.bounds for tile in self._tiles.values()])
        return bounds_of(np.concatenate([each[:, :2].min(axis=0), each[:, 2:].max(axis=0)]))


def _reached_by(g: GridGeometry, factor: int = 1) -> tuple[range, range]:
    """Return rows and columns of tiles that a grid of cells ``factor`` times the map's intersects."""
    bottom, top, left, right = (factor * k for k in (g.top - g.rows, g.top, g.left, g.left + g.cols))
    return range(bottom // TILE, (top - 1) // TILE + 1), range(left // TILE, (right - 1) // TILE + 1)


def _reach(like: GridGeometry, rays: np.ndarray) -> GridGeometry:
    """Return the grid below all rays."""
    x, y = rays[:, [0, 3]], rays[:, [1, 4]]
    return GridGeometry.aligned(like.frame, like.resolution_m, (x.min(), y.min(), x.max(), y.max()))

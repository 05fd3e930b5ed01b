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
from cdff_core.elevation.map_cells import MapCells, bounds_of, middle_of, window_around

#: Cells along the edge of a tile.
TILE = 128


class TiledMapConfig(WindowConfig):
    """Parameters of TiledMap."""

    max_tiles: int = Field(
        2000, ge=1, description="Maximum number of tiles; the least recently used are evicted"
    )
    max_cells: int = Field(
        1 << 22,
        ge=1 << 14,
        description="Maximum number of cells for given bounds; the cell size is doubled until it is met",
    )


class TiledMap(Interface[TiledMapConfig]):
    """Pool each patch into tiles of 128 x 128 cells; memory grows with the observed area.

    Above ``max_tiles`` tiles the least recently used ones are evicted and counted in ``forgotten``. A map for
    given bounds has at most ``max_cells`` cells; if it needs more, cells 2^n times as large are returned.
    """

    def setup(self) -> None:
        """Start with an empty map."""
        visibility.compile_now(1.0)
        self._tiles: OrderedDict[tuple[int, int], MapCells] = OrderedDict()
        self._last_geometry: GridGeometry | None = None
        self._span_ns = (0, 0)
        self._centre = np.zeros(2)

    @property
    def nbytes(self) -> int:
        """Return the memory of all tiles, bytes."""
        return sum(tile.nbytes for tile in self._tiles.values())

    def process(self, inputs: Inputs) -> Outputs:
        """Return the window around the centre, or the map of the bounds, after adding the patch.

        Raises
        ------
        InputError
            If the cells of the patch are not aligned with those of the map, or no call had a patch yet.
        """
        patch, cleared_cells, forgotten_tiles = inputs.patch, 0, 0
        if patch is not None:
            patch_cells = MapCells.of_map(patch, self.config.resolution_m)
            self._start_or_extend(patch_cells.geometry, patch.t0_ns, patch.t1_ns)
            if inputs.centre is None:
                self._centre = middle_of(patch.geometry)
            if inputs.rays is not None:
                for tile in self._tiles_below(inputs.rays):
                    cleared_cells += visibility.clear_seen_through(
                        tile, inputs.rays, patch.t0_ns, self.config.clear_margin_m
                    )
            for key in product(*_tiles_of(patch_cells.geometry)):
                forgotten_tiles += self._add(key, patch_cells)
        if inputs.centre is not None:
            self._centre = np.asarray(inputs.centre, dtype=np.float64)
        output = MapCells.empty(self._output_grid(inputs.bounds))
        factor = round(output.geometry.resolution_m / self._grid.resolution_m)
        rows, cols = _tiles_of(output.geometry, factor)
        for (i, j), tile in self._tiles.items():
            if i in rows and j in cols:
                output.add(tile.coarsened(factor))
        return Outputs(map=output.to_map(*self._span_ns), cleared=cleared_cells, forgotten=forgotten_tiles)

    @property
    def _grid(self) -> GridGeometry:
        """Return a grid with the cells of the map; raises InputError before the first patch."""
        if self._last_geometry is None:
            raise InputError("no patch yet: there is no map to return")
        return self._last_geometry

    def _start_or_extend(self, geometry: GridGeometry, t0_ns: int, t1_ns: int) -> None:
        """Extend the time span of the map by a patch; start an empty map for another frame or cell size."""
        if self._last_geometry is None or not self._last_geometry.shares_cells_with(geometry):
            self._tiles.clear()
            self._last_geometry, self._span_ns = geometry, (t0_ns, t1_ns)
        self._span_ns = (min(self._span_ns[0], t0_ns), max(self._span_ns[1], t1_ns))

    def _tiles_below(self, rays: FloatArray) -> list[MapCells]:
        """Return the tiles that the box around all rays intersects; rays that are not finite are ignored."""
        finite = rays[np.isfinite(rays).all(axis=1)]
        if not len(finite):
            return []
        x, y = finite[:, [0, 3]], finite[:, [1, 4]]
        grid, box = self._grid, (x.min(), y.min(), x.max(), y.max())
        below = product(*_tiles_of(GridGeometry.aligned(grid.frame, grid.resolution_m, box)))
        return [self._tiles[key] for key in below if key in self._tiles]

    def _add(self, key: tuple[int, int], patch_cells: MapCells) -> int:
        """Pool the cells of a patch into one tile; return the number of evicted tiles."""
        tile_geometry = self._geometry(key)
        overlap = patch_cells.geometry.intersection(tile_geometry)
        if overlap is None or not patch_cells.statistics.count[patch_cells.geometry.slices_of(overlap)].any():
            return 0
        if key not in self._tiles:
            self._tiles[key] = MapCells.empty(tile_geometry)
        self._tiles[key].add(patch_cells)
        self._tiles.move_to_end(key)
        if len(self._tiles) <= self.config.max_tiles:
            return 0
        self._tiles.popitem(last=False)
        return 1

    def _geometry(self, key: tuple[int, int]) -> GridGeometry:
        grid, (i, j) = self._grid, key
        return GridGeometry.from_cells(
            grid.frame, grid.resolution_m, left=j * TILE, top=(i + 1) * TILE, rows=TILE, cols=TILE
        )

    def _output_grid(self, bounds: FloatArray | None) -> GridGeometry:
        """Return the grid of the window, or a grid of at most ``max_cells`` cells over the bounds."""
        grid = self._grid
        if bounds is None:
            return window_around(grid.frame, grid.resolution_m, self._centre, self.config.size_m)
        x0, y0, x1, y1 = bounds_of(bounds) if np.all(np.isfinite(bounds)) else self._extent_m()
        cell_m = grid.resolution_m
        while ((x1 - x0) / cell_m + 2.0) * ((y1 - y0) / cell_m + 2.0) > self.config.max_cells:
            cell_m *= 2.0
        return GridGeometry.aligned(grid.frame, cell_m, (x0, y0, x1, y1))

    def _extent_m(self) -> tuple[float, float, float, float]:
        """Return the bounds of all tiles, or of the last patch if no cell has been observed."""
        if not self._tiles:
            return self._grid.bounds
        tile_bounds = np.array([tile.geometry.bounds for tile in self._tiles.values()])
        return bounds_of(np.concatenate([tile_bounds[:, :2].min(axis=0), tile_bounds[:, 2:].max(axis=0)]))


def _tiles_of(grid: GridGeometry, factor: int = 1) -> tuple[range, range]:
    """Return the rows and columns of the tiles that a grid intersects.

    The cells of the grid are ``factor`` times as large as those of the map.
    """
    bottom, top = factor * (grid.top - grid.rows), factor * grid.top
    left, right = factor * grid.left, factor * (grid.left + grid.cols)
    return range(bottom // TILE, (top - 1) // TILE + 1), range(left // TILE, (right - 1) // TILE + 1)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The tile grid of a frame: squares of 256 x 256 cells around the frame's origin; the cell size halves from
level to level.

Level ``z`` has ``2^z x 2^z`` tiles and cells of ``FINEST_M * 2^(LAST_LEVEL - z)`` metres: 12.5 mm at level
20, 5 cm at level 18, 0.1, 0.2, 0.4 m … above it, so that patches of 5 cm, and of any 2^n times as much, pool
into tiles exactly. The corner of tile (0, 0) lies ``HALF_SIDE_M`` left of the frame's origin and above it; x
increases to the right, rows are counted downwards, as in OGC 17-083r4 (Two Dimensional Tile Matrix Set, 2.0)
with ``cornerOfOrigin`` ``topLeft``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import floor, log2
from typing import Any

from cdff_common.errors import InputError
from cdff_common.raster.geometry import GridGeometry

#: Cells along a side of a tile, level with the finest cells, and size of those cells.
TILE_CELLS = 256
LAST_LEVEL = 20
FINEST_M = 0.0125
HALF_SIDE_M = FINEST_M * 2**LAST_LEVEL * TILE_CELLS / 2
#: Side of a pixel of the standard's reference screen, metres (OGC 17-083r4, 6.1.1).
_PIXEL_M = 0.00028


@dataclass(frozen=True, slots=True, order=True)
class Tile:
    """Address of a tile; raises InputError for an address outside the grid.

    Attributes
    ----------
    z : int
        Level, 0 the coarsest.
    x, y : int
        Column from the left, row from the top.
    """

    z: int
    x: int
    y: int

    def __post_init__(self) -> None:
        if not 0 <= self.z <= LAST_LEVEL:
            raise InputError(f"tile level z={self.z}: expected 0 to {LAST_LEVEL}")
        if not (0 <= self.x < 1 << self.z and 0 <= self.y < 1 << self.z):
            raise InputError(
                f"tile x={self.x}, y={self.y}: level {self.z} has columns and rows 0 to {(1 << self.z) - 1}"
            )

    def geometry(self, frame: str, margin: int = 0) -> GridGeometry:
        """Return the grid of the tile's cells, with ``margin`` more on each side."""
        half = (TILE_CELLS // 2) << self.z
        return GridGeometry.from_cells(
            frame,
            cell_m(self.z),
            left=self.x * TILE_CELLS - half - margin,
            top=half - self.y * TILE_CELLS + margin,
            rows=TILE_CELLS + 2 * margin,
            cols=TILE_CELLS + 2 * margin,
        )

    def children(self) -> Iterator[Tile]:
        """Yield the four tiles of the next level."""
        for y in (0, 1):
            for x in (0, 1):
                yield Tile(self.z + 1, 2 * self.x + x, 2 * self.y + y)


def cell_m(z: int) -> float:
    """Return the edge of a cell at a level, metres."""
    return float(FINEST_M * 2 ** (LAST_LEVEL - z))


def level_of(resolution_m: float) -> int:
    """Return the finest level whose cells are no smaller than ``resolution_m``."""
    return min(LAST_LEVEL, max(0, floor(LAST_LEVEL - log2(resolution_m / FINEST_M) + 1e-6)))


def tiles_over(z: int, bounds: tuple[float, float, float, float]) -> tuple[range, range]:
    """Return columns and rows of the tiles of a level that intersect ``bounds`` (xmin, ymin, xmax, ymax,
    m).
    """
    side, last = cell_m(z) * TILE_CELLS, (1 << z) - 1

    def index_at(distance_m: float) -> int:
        return min(max(floor(distance_m / side), 0), last)

    xmin, ymin, xmax, ymax = bounds
    columns = range(index_at(xmin + HALF_SIDE_M), index_at(xmax + HALF_SIDE_M) + 1)
    return columns, range(index_at(HALF_SIDE_M - ymax), index_at(HALF_SIDE_M - ymin) + 1)


def tile_matrix_set(frame: str, crs: Mapping[str, Any]) -> dict[str, Any]:
    """Return the grid as a TileMatrixSet of OGC 17-083r4.

    Parameters
    ----------
    frame : str
    crs : mapping
        ``{"uri": …}`` or ``{"wkt": PROJJSON}``: the frame's CRS, x and y in metres.
    """
    matrices = [
        {
            "id": str(z),
            "scaleDenominator": cell_m(z) / _PIXEL_M,
            "cellSize": cell_m(z),
            "cornerOfOrigin": "topLeft",
            "pointOfOrigin": [-HALF_SIDE_M, HALF_SIDE_M],
            "tileWidth": TILE_CELLS,
            "tileHeight": TILE_CELLS,
            "matrixWidth": 1 << z,
            "matrixHeight": 1 << z,
        }
        for z in range(LAST_LEVEL + 1)
    ]
    return {
        "id": frame.replace("/", "_"),
        "title": f"Tiles of frame {frame}",
        "crs": dict(crs),
        "orderedAxes": ["X", "Y"],
        "boundingBox": {"lowerLeft": [-HALF_SIDE_M, -HALF_SIDE_M], "upperRight": [HALF_SIDE_M, HALF_SIDE_M]},
        "tileMatrices": matrices,
    }

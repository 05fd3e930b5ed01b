# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tiles of a whole body in a CRS that map programs know by its name.

The CRS of a frame is a tangent plane at its origin, which no authority names; programs that accept only names
need one of the body: the equirectangular projection of the IAU (x = R λ, y = R φ), on the Earth the Pseudo
Mercator projection of web maps (EPSG:3857, with the grid of OGC 17-083r4, annex D.1).
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geodesy.bodies import Body
from cdff_common.geodesy.frame_location import FrameLocation
from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.tiles import TILE_CELLS

FloatArray = NDArray[np.float64]

#: Finest level: cells of 1.3 to 2.4 cm at the equators of Mars and the Earth.
LAST_BODY_LEVEL = 22
#: Tiles show a frame up to this distance from its origin, degrees.
REACH_DEG = 5.0
#: Intervals between interpolated points along a side of a tile.
_STEPS = 16
_EQUIRECTANGULAR = 10  # the code of a sphere's projection minus that of the sphere
_WEB_MERCATOR, _WGS_84 = "EPSG:3857", "EPSG:4326"


@dataclass(frozen=True, slots=True)
class BodyGrid:
    """Square grid of tiles around the whole body; level ``z`` has ``2^z`` columns and rows.

    Attributes
    ----------
    authority, code : str
    half_side_m : float
        Distance of its sides from longitude and latitude 0, metres in the CRS.
    """

    authority: str
    code: str
    half_side_m: float

    @property
    def name(self) -> str:
        """Name of the grid, as ``IAU_2015_49910``."""
        return f"{self.authority}_{self.code}"

    @property
    def urn(self) -> str:
        """URN of the CRS (OGC 07-092r3)."""
        return f"urn:ogc:def:crs:{self.authority}::{self.code}"

    @property
    def uri(self) -> str:
        """URI of the CRS."""
        authority, _, version = self.authority.partition("_")
        return f"http://www.opengis.net/def/crs/{authority}/{version or 0}/{self.code}"

    @property
    def crs(self) -> Any:
        """``pyproj.CRS``."""
        import pyproj

        return pyproj.CRS.from_authority(self.authority, self.code)

    def cell_m(self, z: int) -> float:
        """Return the edge of a cell at a level, metres in the CRS."""
        return 2.0 * self.half_side_m / (TILE_CELLS << z)

    def lonlat(self, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return longitudes and latitudes ``(n, 2)``, degrees, of points ``(n, 2)`` in the CRS."""
        return np.column_stack(_to_degrees(self.authority, self.code).transform(xy_m[:, 0], xy_m[:, 1]))

    def from_lonlat(self, lonlat: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points ``(n, 2)`` in the CRS of longitudes and latitudes ``(n, 2)``, degrees."""
        transformer = _to_degrees(self.authority, self.code)
        return np.column_stack(transformer.transform(lonlat[:, 0], lonlat[:, 1], direction="INVERSE"))


@dataclass(frozen=True, slots=True)
class BodyTile:
    """Address of a tile of a body's grid; raises InputError for an address outside of it.

    Attributes
    ----------
    z, x, y : int
        Level, 0 the coarsest; column from the left, row from the top.
    """

    grid: BodyGrid
    z: int
    x: int
    y: int

    def __post_init__(self) -> None:
        if not 0 <= self.z <= LAST_BODY_LEVEL or not (
            0 <= self.x < 1 << self.z and 0 <= self.y < 1 << self.z
        ):
            raise InputError(
                f"tile z={self.z}, x={self.x}, y={self.y}: expected a level up to {LAST_BODY_LEVEL}, and a "
                "column and row below 2^z"
            )

    @property
    def geometry(self) -> GridGeometry:
        """The cells in the CRS of the grid."""
        half = (TILE_CELLS // 2) << self.z
        return GridGeometry.from_cells(
            "body",
            self.grid.cell_m(self.z),
            left=self.x * TILE_CELLS - half,
            top=half - self.y * TILE_CELLS,
            rows=TILE_CELLS,
            cols=TILE_CELLS,
        )

    def points(self, location: FrameLocation) -> tuple[FloatArray, FloatArray, float]:
        """Return x and y ``(256, 256)`` in an anchored frame of the cell centres, and a cell's smaller edge.

        Metres; NaN farther than ``REACH_DEG`` from the frame's origin. They are interpolated between every
        sixteenth cell, which is exact to a hundredth of a cell.
        """
        assert location.anchor is not None
        side = self.grid.cell_m(self.z) * TILE_CELLS
        steps = np.linspace(0.0, side, _STEPS + 1)
        left, top = self.x * side - self.grid.half_side_m, self.grid.half_side_m - self.y * side
        x, y = np.meshgrid(left + steps, top - steps)
        lonlat = self.grid.lonlat(np.column_stack([x.ravel(), y.ravel()]))
        lon, lat = location.anchor.lon_deg, location.anchor.lat_deg
        # beyond the poles of an equirectangular grid there is no surface
        away = np.abs((lonlat[:, 0] - lon + 180.0) % 360.0 - 180.0) * np.cos(np.radians(lat))
        is_near = (away <= REACH_DEG) & (np.abs(lonlat[:, 1] - lat) <= REACH_DEG)
        is_near &= np.isfinite(lonlat).all(axis=1) & (np.abs(lonlat[:, 1]) <= 90.0)
        points = np.full((len(lonlat), 2), np.nan)
        if is_near.any():
            points[is_near] = location.points(lonlat[is_near])[:, :2]
        nodes = points.reshape(_STEPS + 1, _STEPS + 1, 2)
        spans = [np.linalg.norm(np.diff(nodes, axis=axis), axis=-1) for axis in (0, 1)]
        known = [span[np.isfinite(span)] for span in spans]
        edges = [float(np.median(span)) * _STEPS / TILE_CELLS for span in known if len(span)]
        at = (np.arange(TILE_CELLS) + 0.5) * _STEPS / TILE_CELLS
        cells, parts = at.astype(np.intp), (at % 1.0)[:, None]
        rows = nodes[cells] * (1.0 - parts[..., None]) + nodes[cells + 1] * parts[..., None]
        values = rows[:, cells] * (1.0 - parts) + rows[:, cells + 1] * parts
        return values[..., 0], values[..., 1], min(edges, default=np.inf)


def body_grid(body: Body) -> BodyGrid | None:
    """Return the grid of a body; None if no authority defines a CRS of it in metres."""
    if body.crs is None:
        return None
    known = _code_of(body)
    if known == _WGS_84:
        return BodyGrid("EPSG", _WEB_MERCATOR.partition(":")[2], np.pi * body.axes_m[0])
    authority, _, code = known.partition(":")
    if authority != "IAU_2015":
        return None
    projected = str(int(code) + _EQUIRECTANGULAR)
    return BodyGrid(authority, projected, np.pi * body.axes_m[0])


@functools.lru_cache(maxsize=64)
def _code_of(body: Body) -> str:
    return ":".join(body.geographic_crs.to_authority(min_confidence=90) or ("", ""))


@functools.lru_cache(maxsize=64)
def _to_degrees(authority: str, code: str) -> Any:
    import pyproj

    crs = pyproj.CRS.from_authority(authority, code)
    return pyproj.Transformer.from_crs(crs, crs.geodetic_crs, always_xy=True)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where products lie on their body: outlines in metres of their frame, and in degrees of longitude and latitude.

Outlines follow GeoJSON (RFC 7946): longitude before latitude, rings counter-clockwise, cut at the antimeridian. Unlike
there the degrees are those of the body that the site is anchored on (east positive), not of WGS 84.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from cdff_common.errors import InputError
from cdff_common.geodesy import Body, Place
from cdff_common.geometry.region import Region
from dpm_store import ProductRecord, Store
from dpm_store.insertion import FARTHEST_BOX_M

SITE = "site"
#: Points along each side of a box that is carried from degrees to metres: its sides are curved there.
_PER_SIDE = 16
#: Boxes are cut to this much around a site: further away its plane means nothing.
_REACH_DEG = 5.0
#: A point or a line is given some width, degrees: a region encloses an area.
_LEAST_DEG = 1e-9


class Places:
    """Places the products of one answer; frames are looked up once.

    Parameters
    ----------
    store : Store

    Attributes
    ----------
    body : Body or None
        That the site lies on, or without a site the first frame that is anchored; None where nothing is.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self.of = functools.cache(store.places.of)
        self._roots = self._anchored_frames()
        self.body: Body | None = self.of(self._roots[0]).body if self._roots else None

    def outlines(self, records: Sequence[ProductRecord]) -> list[BaseGeometry | None]:
        """Outlines in the x-y plane of each product's own frame, metres; None without a box."""
        rings = self._store.footprints([record.id for record in records if record.header.box_m is not None])
        return [None if (ring := rings.get(record.id)) is None else ring_outline(ring) for record in records]

    def on_body(self, frame: str, outline: BaseGeometry | None) -> BaseGeometry | None:
        """An outline of a frame in degrees, longitude first; None where the frame is not anchored on the body."""
        place = self.of(frame)
        if outline is None or place.anchor is None or place.body != self.body:
            return None
        if max(map(abs, outline.bounds)) > FARTHEST_BOX_M:  # of a store that was filled before such boxes were refused
            return None
        degrees = shapely.transform(outline, lambda xy: place.lonlat(xy)[:, :2])
        if not np.isfinite(degrees.bounds).all():
            return None
        return cut_at_antimeridian(degrees, place.anchor.lon_deg)

    def region(self, bounds_deg: Sequence[float]) -> tuple[str, Region] | None:
        """A frame and a region in it that a box of longitudes and latitudes is searched with.

        None where no one site is near the box: it holds nothing, or several sites.

        Raises
        ------
        InputError
            If it is no box.
        """
        west, south, east, north = checked_box(bounds_deg)
        near = [(f, cut) for f in self._roots if (cut := _cut(self.of(f), west, south, east, north)) is not None]
        if len(near) != 1:
            return None
        frame, (west, south, east, north) = near[0]
        side = max(east - west, north - south) / _PER_SIDE
        box = shapely.segmentize(shapely.box(west, south, east, north), side)
        ring = self.of(frame).points(shapely.get_coordinates(box))[:-1, :2]
        return frame, Region("polygon", tuple(float(v) for v in ring.ravel()))

    def several_sites(self) -> bool:
        """Whether more than one frame is anchored."""
        return len(self._roots) > 1

    def _anchored_frames(self) -> list[str]:
        """Frames that lie on a body themselves, the site before others."""
        bodies = self._store.places.bodies()
        found = [r.frame for r in self._store.frames.current() if r.parent in bodies]
        return sorted((f for f in found if self.of(f).anchor is not None), key=lambda f: (f != SITE, f))


def _cut(
    place: Place, west: float, south: float, east: float, north: float
) -> tuple[float, float, float, float] | None:
    """A box cut to what is near a place, with longitudes around the place's; None where nothing is left."""
    assert place.anchor is not None  # callers ask for anchored frames only
    lon, lat = place.anchor.lon_deg, place.anchor.lat_deg
    if west > east:  # across the antimeridian
        east += 360.0
    reach_lon = min(_REACH_DEG / max(float(np.cos(np.radians(lat))), 0.05), 80.0)
    for turn in (-360.0, 0.0, 360.0):
        x0, x1 = max(west + turn, lon - reach_lon), min(east + turn, lon + reach_lon)
        y0, y1 = max(south, lat - _REACH_DEG), min(north, lat + _REACH_DEG)
        if x0 <= x1 and y0 <= y1:
            return x0, y0, max(x1, x0 + _LEAST_DEG), max(y1, y0 + _LEAST_DEG)
    return None


def checked_box(bounds: Sequence[float]) -> tuple[float, float, float, float]:
    """``(west, south, east, north)`` of 4 or 6 numbers; raises InputError for anything else."""
    values = [float(v) for v in bounds]
    if len(values) == 6:
        values = [values[0], values[1], values[3], values[4]]
    if len(values) != 4 or not np.all(np.isfinite(values)):
        raise InputError(f"bbox {list(bounds)[:8]}: expected 4 or 6 finite numbers")
    west, south, east, north = values
    if south > north:
        raise InputError(f"bbox {list(bounds)}: its south is above its north")
    if max(abs(west), abs(east)) > 360.0 or max(abs(south), abs(north)) > 90.0:
        raise InputError(f"bbox {list(bounds)}: expected longitudes within 360 and latitudes within 90 degrees")
    return west, south, east, north


def ring_outline(ring: NDArray[np.float64]) -> BaseGeometry:
    """A ring ``(n, 2)`` as a polygon, or as the point or line that it shrinks to."""
    distinct = np.unique(ring, axis=0)
    if len(distinct) < 3:
        return shapely.Point(distinct[0]) if len(distinct) == 1 else shapely.LineString(distinct)
    outline = shapely.Polygon(ring)
    return oriented(outline if outline.is_valid and outline.area > 0.0 else shapely.MultiPoint(ring).convex_hull)


def oriented(outline: BaseGeometry) -> BaseGeometry:
    """With outer rings counter-clockwise."""
    return shapely.orient_polygons(outline, exterior_cw=False)


def cut_at_antimeridian(outline: BaseGeometry, near_lon_deg: float) -> BaseGeometry:
    """An outline around a longitude with all longitudes within ±180°, in parts where it crosses the antimeridian."""

    def near(lon_lat: NDArray[np.float64]) -> NDArray[np.float64]:
        turns = np.round((lon_lat[:, 0] - near_lon_deg) / 360.0)
        return np.column_stack([lon_lat[:, 0] - 360.0 * turns, lon_lat[:, 1]])

    whole = shapely.transform(outline, near)
    west, _, east, _ = whole.bounds
    if west >= -180.0 and east <= 180.0:
        return oriented(whole)
    parts = []
    for turn in (-360.0, 0.0, 360.0):
        part = shapely.intersection(whole, shapely.box(turn - 180.0, -90.0, turn + 180.0, 90.0))
        if not part.is_empty and shapely.get_dimensions(part) == shapely.get_dimensions(whole):
            parts.append(shapely.transform(part, functools.partial(_turned, turn=turn)))
    return oriented(parts[0] if len(parts) == 1 else shapely.union_all(parts))


def _turned(lon_lat: NDArray[np.float64], turn: float) -> NDArray[np.float64]:
    return np.column_stack([lon_lat[:, 0] - turn, lon_lat[:, 1]])


def geojson(outline: BaseGeometry | None) -> dict[str, Any] | None:
    """A geometry as GeoJSON."""
    return None if outline is None else dict(shapely.geometry.mapping(outline))

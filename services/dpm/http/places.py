# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Where products lie on their body: outlines in metres of the site, and in degrees of longitude and latitude.

Outlines follow GeoJSON (RFC 7946): longitude before latitude, rings counter-clockwise, cut at the antimeridian. Unlike
there the degrees are those of the body that the site is anchored on (planetocentric, east positive), not of WGS 84.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from cdff_common.errors import FrameNotFoundError, InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import MAX_CORNERS, Region
from dpm_store import ProductRecord, Store
from services.dpm.anchor import Anchor

_CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=bool)
#: Points along each side of a box that is carried from degrees to metres: its sides are curved there.
_PER_SIDE = 16
#: Boxes in degrees are cut to this much around the site: further away the site's plane means nothing.
_REACH_DEG = 5.0


class Places:
    """Places products of one request; frames are looked up once.

    Parameters
    ----------
    store : Store
    anchor : Anchor or None
        Where the site lies; None where it is not anchored.
    """

    def __init__(self, store: Store, anchor: Anchor | None) -> None:
        self._store = store
        self.anchor = anchor
        self._in_site = functools.cache(self._look_up)

    def in_site(self, record: ProductRecord) -> BaseGeometry | None:
        """Outline in the x-y plane of the site, metres; None without a box, or in a frame that cannot be joined."""
        return None if record.header.box_m is None else self.box_in_site(record.header.frame, record.header.box_m)

    def box_in_site(self, frame: str, box_m: Sequence[float]) -> BaseGeometry | None:
        """Outline of ``xmin ymin zmin xmax ymax zmax`` of a frame in the plane of the site; None as ``in_site``."""
        T = self._in_site(frame)
        if T is None:
            return None
        box = np.asarray(box_m, dtype=np.float64)
        corners = T.apply(np.where(_CORNERS, box[3:], box[:3]))[:, :2]
        return oriented(shapely.MultiPoint(corners).convex_hull)

    def on_body(self, outline: BaseGeometry | None) -> BaseGeometry | None:
        """An outline of the site in degrees of the body, longitude first; None where the site is not anchored."""
        if outline is None or self.anchor is None:
            return None
        return cut_at_antimeridian(shapely.transform(outline, self.anchor.to_degrees), self.anchor.lon_deg)

    def region(self, bounds_deg: Sequence[float]) -> Region | None:
        """A box of longitudes and latitudes as a region of the site; None where it is nowhere near the site.

        Raises
        ------
        InputError
            If it is no box.
        """
        west, south, east, north = checked_box(bounds_deg)
        if self.anchor is None:
            return None
        lon, lat = self.anchor.lon_deg, self.anchor.lat_deg
        if west > east:  # across the antimeridian
            east += 360.0
        shift = 360.0 * np.round((lon - (west + east) / 2.0) / 360.0)
        west, east = west + shift, east + shift
        reach_lon = min(_REACH_DEG / max(np.cos(np.radians(lat)), 0.05), 80.0)
        west, east = max(west, lon - reach_lon), min(east, lon + reach_lon)
        south, north = max(south, lat - _REACH_DEG), min(north, lat + _REACH_DEG)
        if west > east or south > north:
            return None
        least = 1e-9  # a point or a line is given some width: a region encloses an area
        outline = shapely.segmentize(
            shapely.box(west, south, max(east, west + least), max(north, south + least)),
            max(east - west, north - south, least) / _PER_SIDE,
        )
        ring = self.anchor.to_metres(shapely.get_coordinates(outline))[:-1]
        return Region("polygon", tuple(float(v) for v in ring[:MAX_CORNERS].ravel()))

    def _look_up(self, frame: str) -> UncertainTransform | None:
        try:
            return self._store.frames.lookup("site", frame)
        except FrameNotFoundError:
            return None


def checked_box(bounds: Sequence[float]) -> tuple[float, float, float, float]:
    """``(west, south, east, north)`` of 4 or 6 numbers; raises InputError for anything else."""
    values = [float(v) for v in bounds]
    if len(values) == 6:
        values = [values[0], values[1], values[3], values[4]]
    if len(values) != 4 or not np.all(np.isfinite(values)):
        raise InputError(f"bbox {list(bounds)}: expected 4 or 6 finite numbers")
    west, south, east, north = values
    if south > north:
        raise InputError(f"bbox {list(bounds)}: its south is above its north")
    return west, south, east, north


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
        if not part.is_empty and part.geom_type == whole.geom_type:
            parts.append(shapely.transform(part, lambda xy, turn=turn: xy - [turn, 0.0]))  # type: ignore[misc]
    return oriented(parts[0] if len(parts) == 1 else shapely.union_all(parts))


def geojson(outline: BaseGeometry | None, swap: bool = False) -> dict[str, Any] | None:
    """A geometry as GeoJSON; ``swap`` puts the second coordinate first."""
    if outline is None:
        return None
    if swap:
        outline = shapely.transform(outline, lambda xy: xy[:, ::-1])
    data: dict[str, Any] = shapely.geometry.mapping(outline)
    return data

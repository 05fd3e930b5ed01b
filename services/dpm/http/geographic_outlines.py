# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Outlines of products in metres of their frame, and in degrees of longitude and latitude.

Outlines follow GeoJSON (RFC 7946): longitude before latitude, rings counter-clockwise, cut at the
antimeridian. Unlike there, degrees refer to the body on which the frame of a product is anchored (east
positive), not to WGS 84.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from cdff_common.errors import InputError
from cdff_common.geodesy import Body, FrameLocation
from cdff_common.geometry.region import Region
from dpm_store import ProductRecord, Store
from dpm_store.products.insertion import FARTHEST_BOX_M

SITE = "site"
#: Points along each side of a box that is transformed from degrees to metres, where its sides are curved.
_POINTS_PER_SIDE = 16
#: Boxes are cut to this distance around a site: beyond it the tangent plane is no usable approximation.
_REACH_DEG = 5.0
#: Minimum extent of a region, degrees: points and lines are widened to it.
MIN_EXTENT_DEG = 1e-9


class ProductOutlines:
    """Outlines of the products of one answer; frames are looked up once.

    Attributes
    ----------
    body : Body or None
        Body of the site, or without a site of the first anchored frame; None if no frame is anchored.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self.of = functools.cache(store.anchors.of)
        self._roots = self._anchored_frames()
        self.body: Body | None = self.of(self._roots[0]).body if self._roots else None

    def outlines_in_frame(self, records: Sequence[ProductRecord]) -> list[BaseGeometry | None]:
        """Return the outline of each product in the x-y plane of its frame, metres.

        None for a product without a box.
        """
        rings = self._store.footprints([record.id for record in records if record.header.box_m is not None])
        return [None if (ring := rings.get(record.id)) is None else ring_outline(ring) for record in records]

    def live(self, product_ids: Iterable[str]) -> frozenset[str]:
        """Return those of some ids whose products are stored and not deleted."""
        return self._store.live(product_ids)

    def body_of(self, frame: str) -> Body | None:
        """Return the body on which a frame is anchored; None if it has no longitude and latitude."""
        location = self.of(frame)
        return None if location.anchor is None else location.body

    def outline_in_degrees(self, frame: str, outline: BaseGeometry | None) -> BaseGeometry | None:
        """Return an outline in a frame as degrees on its body, longitude first; None if the frame is not
        anchored.
        """
        location = self.of(frame)
        if outline is None or location.anchor is None:
            return None
        # a store may contain such boxes from before they were refused
        if max(map(abs, outline.bounds)) > FARTHEST_BOX_M:
            return None
        degrees = shapely.transform(outline, lambda xy: location.lonlat(xy)[:, :2])
        if not np.isfinite(degrees.bounds).all():
            return None
        return cut_at_antimeridian(degrees, location.anchor.lon_deg)

    def heights_m(self, frame: str, box_m: Sequence[float]) -> tuple[float, float]:
        """Return the least and greatest height of the corners of a box in an anchored frame, metres above
        the sphere or ellipsoid of its body.
        """
        corners = np.array(np.meshgrid(box_m[0::3], box_m[1::3], box_m[2::3])).reshape(3, -1).T
        heights = self.of(frame).lonlat(corners)[:, 2]
        return float(heights.min()), float(heights.max())

    def regions(self, bounds_deg: Sequence[float], body: Body | None = None) -> list[tuple[str, Region]]:
        """Return frames and regions in them which together cover a box of longitudes and latitudes near
        anchored frames.

        A body connects its sites: one frame is enough for all products near it. ``body`` restricts the
        frames to those on it.

        Raises
        ------
        InputError
            If the bounds are not a valid box.
        """
        box = checked_box(bounds_deg)
        parts: dict[tuple[Any, ...], str] = {}
        for frame in self._roots:
            location = self.of(frame)
            if body is None or location.body == body:
                for part in _near(location, *box):
                    parts.setdefault((location.body, *part), frame)
        return [(frame, self._region(frame, part)) for (_, *part), frame in parts.items()]

    def _region(self, frame: str, bounds_deg: Sequence[float]) -> Region:
        west, south, east, north = bounds_deg
        side = max(east - west, north - south) / _POINTS_PER_SIDE
        box = shapely.segmentize(shapely.box(west, south, east, north), side)
        ring = self.of(frame).points(shapely.get_coordinates(box))[:-1, :2]
        return Region("polygon", tuple(float(v) for v in ring.ravel()))

    def _anchored_frames(self) -> list[str]:
        """Return the frames that are anchored directly on a body, the site first."""
        bodies = self._store.anchors.bodies()
        frames = [r.frame for r in self._store.frames.current() if r.parent in bodies]
        return sorted((f for f in frames if self.of(f).anchor is not None), key=lambda f: (f != SITE, f))


def _near(
    location: FrameLocation, west: float, south: float, east: float, north: float
) -> Iterator[tuple[float, float, float, float]]:
    """Yield the parts of a box near an anchor, with longitudes near its own."""
    assert location.anchor is not None  # callers ask for anchored frames only
    lon, lat = location.anchor.lon_deg, location.anchor.lat_deg
    if west > east:  # across the antimeridian
        east += 360.0
    y0, y1 = max(south, lat - _REACH_DEG), min(north, lat + _REACH_DEG)
    if y0 > y1:
        return
    reach_lon = min(_REACH_DEG / max(float(np.cos(np.radians(lat))), 0.05), 80.0)
    last_east = -np.inf
    for offset_deg in (-360.0, 0.0, 360.0):
        x0, x1 = max(west + offset_deg, lon - reach_lon, last_east), min(east + offset_deg, lon + reach_lon)
        if x0 <= x1:
            last_east = x1
            yield x0, y0, max(x1, x0 + MIN_EXTENT_DEG), max(y1, y0 + MIN_EXTENT_DEG)


def checked_box(bounds: Sequence[float]) -> tuple[float, float, float, float]:
    """Return ``(west, south, east, north)`` from 4 or 6 numbers; raises InputError for anything else."""
    values = [float(v) for v in bounds]
    if len(values) == 6:
        values = [values[0], values[1], values[3], values[4]]
    if len(values) != 4 or not np.all(np.isfinite(values)):
        raise InputError(f"bbox {list(bounds)[:8]}: expected 4 or 6 finite numbers")
    west, south, east, north = values
    if south > north:
        raise InputError(f"bbox {list(bounds)}: its southern limit is north of its northern limit")
    if max(abs(west), abs(east)) > 360.0 or max(abs(south), abs(north)) > 90.0:
        raise InputError(
            f"bbox {list(bounds)}: expected longitudes within 360 and latitudes within 90 degrees"
        )
    return west, south, east, north


def ring_outline(ring: NDArray[np.float64]) -> BaseGeometry:
    """Return a ring ``(n, 2)`` as a polygon; as a point or a line if it encloses no area."""
    if len(ring) >= 3:
        polygon = shapely.Polygon(ring)
        if polygon.is_valid and polygon.area > 0.0:
            return oriented(polygon)
    distinct = np.unique(ring, axis=0)
    if len(distinct) < 3:
        return shapely.Point(distinct[0]) if len(distinct) == 1 else shapely.LineString(distinct)
    return oriented(shapely.MultiPoint(ring).convex_hull)


def oriented(outline: BaseGeometry) -> BaseGeometry:
    """Return an outline with its outer rings counter-clockwise."""
    return shapely.orient_polygons(outline, exterior_cw=False)


def cut_at_antimeridian(outline: BaseGeometry, near_lon_deg: float) -> BaseGeometry:
    """Return an outline with all longitudes within ±180°, in several parts if it crosses the antimeridian.

    Longitudes of the argument are shifted by 360° to be near ``near_lon_deg`` first.
    """

    def shift_near(lon_lat: NDArray[np.float64]) -> NDArray[np.float64]:
        turns = np.round((lon_lat[:, 0] - near_lon_deg) / 360.0)
        return np.column_stack([lon_lat[:, 0] - 360.0 * turns, lon_lat[:, 1]])

    west, _, east, _ = outline.bounds
    if max(-180.0, near_lon_deg - 180.0) < west and east < min(180.0, near_lon_deg + 180.0):
        return oriented(outline)
    shifted = shapely.transform(outline, shift_near)
    west, _, east, _ = shifted.bounds
    if west >= -180.0 and east <= 180.0:
        return oriented(shifted)
    parts = []
    for offset_deg in (-360.0, 0.0, 360.0):
        part = shapely.intersection(shifted, shapely.box(offset_deg - 180.0, -90.0, offset_deg + 180.0, 90.0))
        if not part.is_empty and shapely.get_dimensions(part) == shapely.get_dimensions(shifted):
            parts.append(shapely.transform(part, functools.partial(_shifted, offset_deg=offset_deg)))
    return oriented(parts[0] if len(parts) == 1 else shapely.union_all(parts))


def _shifted(lon_lat: NDArray[np.float64], offset_deg: float) -> NDArray[np.float64]:
    return np.column_stack([lon_lat[:, 0] - offset_deg, lon_lat[:, 1]])


def geojson(outline: BaseGeometry | None) -> dict[str, Any] | None:
    """Return a geometry as GeoJSON."""
    if outline is None:
        return None
    if isinstance(outline, shapely.Polygon) and not outline.is_empty and not len(outline.interiors):
        return {"type": "Polygon", "coordinates": [shapely.get_coordinates(outline).tolist()]}
    return dict(shapely.geometry.mapping(outline))

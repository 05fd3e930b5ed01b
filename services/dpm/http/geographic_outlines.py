# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Outlines of products in metres of their frame, and in degrees of longitude and latitude.

Outlines follow GeoJSON (RFC 7946): longitude before latitude, rings counter-clockwise, cut at the
antimeridian. Unlike there, degrees refer to the body on which the frame of a product is anchored (east
positive), not to WGS 84.
"""

from __future__ import annotations

import functools
import threading
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
#: Largest number of corners of an outline in a list of features.
MAX_CORNERS = 12
_ANGLES = 2.0 * np.pi * np.arange(MAX_CORNERS) / MAX_CORNERS
_DIRECTIONS = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])


class OutlinesCache:
    """The outlines of the newest state of the frames and bodies, for the answers of a server."""

    def __init__(self) -> None:
        self._state: tuple[int, int] | None = None
        self._outlines: ProductOutlines | None = None
        self._lock = threading.Lock()

    def get(self, store: Store) -> ProductOutlines:
        """Return the outlines of products of a store."""
        state = (store.frames.state(), store.anchors.revision())
        with self._lock:
            if self._outlines is None or self._state != state:
                self._state, self._outlines = state, ProductOutlines(store)
            return self._outlines


class ProductOutlines:
    """Outlines of products in one state of the frames and bodies; each frame is looked up once.

    Attributes
    ----------
    body : Body or None
        Body of the site, or without a site of the first anchored frame; None if no frame is anchored.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self.of = functools.lru_cache(maxsize=1000)(store.anchors.of)  # callers choose the names
        self._roots = self._anchored_frames()
        self.body: Body | None = self.of(self._roots[0]).body if self._roots else None

    def outlines_in_frame(self, records: Sequence[ProductRecord]) -> list[BaseGeometry | None]:
        """Return the outline of each product in the x-y plane of its frame, metres.

        None for a product without a box.
        """
        rings = self._store.footprints([record.id for record in records])
        outlined_ids = [record.id for record in records if record.id in rings]
        outlines = dict(zip(outlined_ids, ring_outlines([rings[i] for i in outlined_ids]), strict=True))
        return [outlines.get(record.id) for record in records]

    def live(self, product_ids: Iterable[str]) -> frozenset[str]:
        """Return the ids among ``product_ids`` whose products are stored and not deleted."""
        return self._store.live(product_ids)

    def body_of(self, frame: str) -> Body | None:
        """Return the body on which a frame is anchored; None if it has no longitude and latitude."""
        location = self.of(frame)
        return None if location.anchor is None else location.body

    def outline_in_degrees(self, frame: str, outline: BaseGeometry | None) -> BaseGeometry | None:
        """Return an outline in a frame as degrees on its body, longitude first; None if the frame is not
        anchored.
        """
        return self.outlines_in_degrees([frame], [outline])[0]

    def outlines_in_degrees(
        self, frames: Sequence[str], outlines: Sequence[BaseGeometry | None]
    ) -> list[BaseGeometry | None]:
        """Return ``outline_in_degrees`` of outlines in their frames, with one transformation per frame."""
        results: list[BaseGeometry | None] = [None] * len(outlines)
        of_frame: dict[str, list[int]] = {}
        for index, (frame, outline) in enumerate(zip(frames, outlines, strict=True)):
            if outline is not None:
                of_frame.setdefault(frame, []).append(index)
        for frame, indices in of_frame.items():
            location = self.of(frame)
            if location.anchor is None:
                continue
            in_frame = np.array([outlines[i] for i in indices], dtype=object)
            # Boxes farther away are refused today, but an older store may contain them.
            usable = np.abs(shapely.bounds(in_frame)).max(axis=1) <= FARTHEST_BOX_M
            degrees = shapely.transform(in_frame[usable], lambda xy, of=location: of.lonlat(xy)[:, :2])
            is_finite = np.isfinite(shapely.bounds(degrees)).all(axis=1)
            cut = cut_all_at_antimeridian(degrees[is_finite], location.anchor.lon_deg)
            for index, outline in zip(np.array(indices)[usable][is_finite].tolist(), cut, strict=True):
                results[index] = outline
        return results

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


def ring_outlines(rings: Sequence[NDArray[np.float64]]) -> list[BaseGeometry]:
    """Return rings ``(n, 2)`` as polygons; see ``ring_outline``."""
    results: list[Any] = [None] * len(rings)
    long = [i for i, ring in enumerate(rings) if len(ring) >= 3]
    if long:
        indices = np.repeat(np.arange(len(long)), [len(rings[i]) for i in long])
        rings_of = shapely.linearrings(np.concatenate([rings[i] for i in long]), indices=indices)
        polygons = shapely.polygons(rings_of)
        regular = shapely.is_valid(polygons) & (shapely.area(polygons) > 0.0)
        polygons = shapely.orient_polygons(polygons, exterior_cw=False)
        for i, polygon, is_regular in zip(long, polygons, regular.tolist(), strict=True):
            results[i] = polygon if is_regular else None
    return [ring_outline(rings[i]) if outline is None else outline for i, outline in enumerate(results)]


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


def cut_all_at_antimeridian(outlines: NDArray[Any], near_lon_deg: float) -> list[BaseGeometry]:
    """Return ``cut_at_antimeridian`` of each outline; most need no cut."""
    bounds = shapely.bounds(outlines)
    west, east = max(-180.0, near_lon_deg - 180.0), min(180.0, near_lon_deg + 180.0)
    is_inside = (bounds[:, 0] > west) & (bounds[:, 2] < east)
    oriented_outlines = shapely.orient_polygons(outlines, exterior_cw=False)
    return [
        plain if inside else cut_at_antimeridian(outline, near_lon_deg)
        for outline, plain, inside in zip(outlines, oriented_outlines, is_inside.tolist(), strict=True)
    ]


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
    """Return a geometry as GeoJSON; the coordinates of a polygon are an array ``(n, 2)``."""
    if outline is None:
        return None
    if isinstance(outline, shapely.Polygon) and not outline.is_empty and not len(outline.interiors):
        return {"type": "Polygon", "coordinates": [shapely.get_coordinates(outline)]}
    return dict(shapely.geometry.mapping(outline))


def rounded(outlines: Sequence[BaseGeometry | None], decimals: int) -> list[BaseGeometry | None]:
    """Return geometries with coordinates that are rounded to a number of decimals."""
    known = np.array([outline for outline in outlines if outline is not None], dtype=object)
    values = iter(shapely.transform(known, lambda xy: np.round(xy, decimals)).tolist())
    return [None if outline is None else next(values) for outline in outlines]


def enclosing(outlines: Sequence[BaseGeometry | None]) -> list[BaseGeometry | None]:
    """Return each outline; one with more than ``MAX_CORNERS`` corners is replaced by a polygon that encloses
    it.

    Its sides are tangents of the outline in ``MAX_CORNERS`` directions (a discrete oriented polytope,
    Klosowski et al. 1998, doi:10.1109/2945.675649): it exceeds a circle by 4 % of its radius.
    """
    results = list(outlines)
    many = [
        i
        for i, outline in enumerate(outlines)
        if outline is not None and shapely.get_num_coordinates(outline) > MAX_CORNERS + 1
    ]
    if many:
        polygons = _tangent_polygons(np.array([outlines[i] for i in many], dtype=object))
        for i, polygon in zip(many, polygons, strict=True):
            results[i] = polygon
    return results


def _tangent_polygons(outlines: NDArray[Any]) -> NDArray[Any]:
    points, indices = shapely.get_coordinates(outlines, return_index=True)
    starts = np.searchsorted(indices, np.arange(len(outlines)))
    centres = points[starts]
    offsets = points - centres[indices]
    distances = np.maximum.reduceat(offsets @ _DIRECTIONS.T, starts, axis=0)
    # the corner between two adjacent tangents solves n_k · x = d_k, n_(k+1) · x = d_(k+1)
    step = 2.0 * np.pi / MAX_CORNERS
    along = (np.roll(distances, -1, axis=1) - distances * np.cos(step)) / np.sin(step)
    normals = np.column_stack([-_DIRECTIONS[:, 1], _DIRECTIONS[:, 0]])
    corners = distances[:, :, None] * _DIRECTIONS + along[:, :, None] * normals
    # the hull removes corners that coincide
    return np.asarray(shapely.convex_hull(shapely.polygons(centres[:, None] + corners)))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The place of a search in degrees: a box, with heights if it has six numbers, or a geometry."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from cdff_common.errors import InputError
from dpm_store.search.filters import Call
from services.dpm.http.geographic_outlines import (
    MIN_EXTENT_DEG,
    ProductOutlines,
    checked_box,
    cut_at_antimeridian,
)

if TYPE_CHECKING:
    from services.dpm.http.stac.catalogue import OutlinedProduct

#: Largest number of corners of a geometry in a search.
MAX_CORNERS = 10_000


class Place:
    """A box or a geometry in degrees, or everywhere.

    Parameters
    ----------
    places : ProductOutlines
    bbox : sequence of 4 or 6, optional
        West, south, east, north, in degrees; with 6 numbers a height in metres above the sphere or
        ellipsoid follows each corner. West is east of east across the antimeridian.
    intersects : geometry, optional
        Degrees, instead of ``bbox``.

    Raises
    ------
    InputError
        If the box is not valid.

    Attributes
    ----------
    outline : geometry or None
        Longitudes within ±180; None for everywhere.
    bounds : tuple
        West, south, east, north of the box or geometry.
    """

    def __init__(
        self, places: ProductOutlines, bbox: Sequence[float] | None, intersects: BaseGeometry | None = None
    ) -> None:
        self._places, self._is_box = places, bbox is not None
        self._heights_m = None if bbox is None or len(bbox) != 6 else (float(bbox[2]), float(bbox[5]))
        if self._heights_m is not None and self._heights_m[0] > self._heights_m[1]:
            raise InputError(f"bbox {list(bbox or ())}: its lowest height is above its greatest")
        self.outline = intersects if bbox is None else box_outline(bbox)
        self.bounds: tuple[float, ...] = ()
        if self.outline is not None:
            self.bounds = self.outline.bounds if bbox is None else checked_box(bbox)

    @property
    def is_plain_box(self) -> bool:
        """True for a box without heights, for which the regions of the place are exact."""
        return self._is_box and self._heights_m is None

    def touching(self, products: Sequence[OutlinedProduct]) -> list[OutlinedProduct]:
        """Return the products that touch the place; heights are compared as intervals."""
        if self.outline is None or not products:
            return list(products)
        outlines = np.array([product.in_degrees for product in products], dtype=object)
        shapely.prepare(self.outline)
        touching = shapely.intersects(self.outline, outlines).tolist()
        return [
            product
            for product, touches in zip(products, touching, strict=True)
            if touches and self._has_heights_of(product)
        ]

    def _has_heights_of(self, product: OutlinedProduct) -> bool:
        box_m = product.record.fields.get("box_m")
        if self._heights_m is None or box_m is None:
            return True
        low_m, high_m = self._places.heights_m(product.record.fields["frame"], box_m)
        return low_m <= self._heights_m[1] and high_m >= self._heights_m[0]


@dataclass(frozen=True, slots=True)
class Touching:
    """Part of an expression: products that touch a place, a box or a geometry in degrees."""

    place: tuple[tuple[float, ...] | None, BaseGeometry | None]


def touching_place(data: Any) -> Touching:
    """Return the part of an expression for a ``bbox`` as a list, or a GeoJSON geometry; raises InputError."""
    if isinstance(data, list):
        if not all(isinstance(value, int | float) for value in data):
            raise InputError("filter: bbox: expected 4 or 6 numbers")
        checked_box(data)
        return Touching((tuple(map(float, data)), None))
    return Touching((None, geometry_of(data, "filter")))


def required_place(where: Any) -> tuple[BaseGeometry | None, Any]:
    """Return a geometry that all products of an expression touch, and the rest of the expression.

    The geometry is None if the expression requires none, or several.
    """
    if isinstance(where, Touching):
        return _outline_of(where), None
    if not isinstance(where, Call) or where.op != "and":
        return None, where
    places = [argument for argument in where.args if isinstance(argument, Touching)]
    if len(places) != 1:
        return None, where
    others = tuple(argument for argument in where.args if argument is not places[0])
    return _outline_of(places[0]), Call("and", others) if others else None


def _outline_of(touching: Touching) -> BaseGeometry:
    bbox, geometry = touching.place
    return geometry if bbox is None else box_outline(bbox)


def both(first: Any, second: Any) -> Any:
    """Return the conjunction of two expressions; the first may be None."""
    return second if first is None else Call("and", (first, second))


def geometry_of(data: Any, name: str = "intersects") -> BaseGeometry:
    """Return a GeoJSON geometry; raises InputError if the value is no geometry, has too many corners, or
    intersects itself.
    """
    if not isinstance(data, dict):
        raise InputError(f"{name}: a {type(data).__name__}, expected a GeoJSON geometry")
    if (numbers := _numbers_in(data.get("coordinates", data.get("geometries")))) > 3 * MAX_CORNERS:
        raise InputError(f"{name}: {numbers} numbers, expected at most {MAX_CORNERS} corners")
    try:
        geometry = shapely.from_geojson(json.dumps(data))
    except (shapely.errors.GEOSException, ValueError, TypeError, RecursionError) as error:
        raise InputError(f"{name}: expected a GeoJSON geometry: {str(error)[:200]}") from error
    if geometry is None or geometry.is_empty or data.get("type") in ("Feature", "FeatureCollection"):
        raise InputError(f"{name}: expected a GeoJSON geometry with coordinates")
    coordinates = shapely.get_coordinates(geometry)
    if len(coordinates) > MAX_CORNERS:
        raise InputError(f"{name}: {len(coordinates)} corners, expected at most {MAX_CORNERS}")
    if not bool((abs(coordinates) <= [540.0, 90.0]).all()):
        raise InputError(f"{name}: expected degrees, longitude first, latitude within ±90")
    if not geometry.is_valid:
        raise InputError(f"{name}: {shapely.is_valid_reason(geometry)}")
    return geometry


def _numbers_in(data: Any) -> int:
    """Return how many numbers nested lists and objects contain, without recursion."""
    count, open_lists = 0, [data]
    while open_lists:
        value = open_lists.pop()
        if isinstance(value, list):
            open_lists += value
        elif isinstance(value, dict):
            open_lists += value.values()
        elif isinstance(value, int | float):
            count += 1
    return count


def box_outline(bbox: Sequence[float]) -> BaseGeometry:
    """Return a box in degrees with longitudes within ±180, in two parts if it crosses the antimeridian.

    Its western limit is east of its eastern one if it crosses the antimeridian (RFC 7946 §5.2); limits
    beyond ±180 are accepted too.
    """
    west, south, east, north = checked_box(bbox)
    if west > east:
        east += 360.0
    if east - west >= 360.0:
        west, east = -180.0, 180.0
    box = shapely.box(west, south, max(east, west + MIN_EXTENT_DEG), max(north, south + MIN_EXTENT_DEG))
    return cut_at_antimeridian(box, (west + east) / 2.0)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The place of a search in degrees: a box, with heights if it has six numbers, or a geometry."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import shapely
from shapely.geometry.base import BaseGeometry

from cdff_common.errors import InputError
from services.dpm.http.geographic_outlines import (
    MIN_EXTENT_DEG,
    ProductOutlines,
    checked_box,
    cut_at_antimeridian,
)

if TYPE_CHECKING:
    from services.dpm.http.stac.catalogue import OutlinedProduct


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

    def touches(self, product: OutlinedProduct) -> bool:
        """Return whether a product shares a point with the place; its heights are compared as an interval."""
        if self.outline is None:
            return True
        if product.in_degrees is None or not product.in_degrees.intersects(self.outline):
            return False
        header = product.record.header
        if self._heights_m is None or header.box_m is None:
            return True
        low_m, high_m = self._places.heights_m(header.frame, header.box_m)
        return low_m <= self._heights_m[1] and high_m >= self._heights_m[0]


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

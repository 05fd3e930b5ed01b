# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Regions of contract §6: ``bbox | box | circle | polygon | near``, metres in a frame named elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import checked_frame
from cdff_common.raster.geometry import Bounds, GridGeometry

_FORMS = "bbox:xmin,ymin,xmax,ymax | box:xmin,ymin,zmin,xmax,ymax,zmax | circle:x,y,r | polygon:x1,y1,… | near:frame,r"
_COUNTS = {"bbox": 4, "box": 6, "circle": 3}
_MAX_VERTICES = 10_000


@dataclass(frozen=True, slots=True)
class Region:
    """An area in x and y, for ``box`` with a span in z.

    Attributes
    ----------
    kind : str
        ``bbox``, ``box``, ``circle``, ``polygon`` or ``near``.
    values : tuple of float
        The numbers of the text, metres; for ``near`` only the radius.
    near_frame : str or None
        For ``near`` the frame whose origin is the centre; ``resolved`` makes it a circle once that is known.
    """

    kind: str
    values: tuple[float, ...]
    near_frame: str | None = None

    @classmethod
    def parse(cls, text: str) -> Region:
        """Read a region from its text.

        Raises
        ------
        InputError
            On another form, a number that is missing, extra or not finite, a reversed box, a radius not above 0, or a
            polygon of fewer than 3 corners.
        """
        kind, _, rest = text.partition(":")
        fields = rest.split(",")
        if kind == "near":
            frame = checked_frame(fields[0], f"region={text!r}: frame")
            return cls("near", _checked_radius(_numbers(text, fields[1:], 1), text), frame)
        if kind == "polygon":
            if len(fields) < 6 or len(fields) % 2 or len(fields) > 2 * _MAX_VERTICES:
                raise InputError(f"region={text[:80]!r}: a polygon needs x,y of 3 to {_MAX_VERTICES} corners")
            region = cls("polygon", _numbers(text, fields, len(fields)))
            if not region.area_m2 > 0.0:
                raise InputError(f"region={text[:80]!r}: the polygon encloses no area")
            return region
        if kind not in _COUNTS:
            raise InputError(f"region={text[:80]!r}: expected {_FORMS}")
        values = _numbers(text, fields, _COUNTS[kind])
        if kind == "circle":
            return cls(kind, (*values[:2], *_checked_radius(values[2:], text)))
        half = len(values) // 2
        if any(low >= high for low, high in zip(values[:half], values[half:], strict=True)):
            raise InputError(f"region={text!r}: expected every minimum below its maximum")
        return cls(kind, values)

    @property
    def text(self) -> str:
        """The text it is parsed from."""
        numbers = ",".join(f"{v:.15g}" for v in self.values)
        return f"near:{self.near_frame},{numbers}" if self.kind == "near" else f"{self.kind}:{numbers}"

    def resolved(self, x_m: float, y_m: float) -> Region:
        """A ``near`` region as the circle around ``(x_m, y_m)``, where its frame's origin is; others as they are."""
        return Region("circle", (float(x_m), float(y_m), self.values[0])) if self.kind == "near" else self

    @property
    def bounds(self) -> Bounds:
        """Smallest rectangle around it, metres; raises InputError for a ``near`` that is not resolved."""
        v = self.values
        if self.kind == "bbox":
            return Bounds(*v)
        if self.kind == "box":
            return Bounds(v[0], v[1], v[3], v[4])
        if self.kind == "circle":
            return Bounds(v[0] - v[2], v[1] - v[2], v[0] + v[2], v[1] + v[2])
        if self.kind == "polygon":
            return Bounds(min(v[0::2]), min(v[1::2]), max(v[0::2]), max(v[1::2]))
        raise self._unresolved()

    @property
    def z_range_m(self) -> tuple[float, float] | None:
        """Lowest and highest z of a ``box``, metres; None where the region is unbounded in z."""
        return (self.values[2], self.values[5]) if self.kind == "box" else None

    @property
    def area_m2(self) -> float:
        """Area, square metres (of a self-crossing polygon: the shoelace area)."""
        v = self.values
        if self.kind in ("circle", "near"):
            return pi * v[-1] ** 2
        if self.kind == "polygon":
            x, y = np.asarray(v[0::2]), np.asarray(v[1::2])
            x, y = x - x[0], y - y[0]
            return float(abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2.0)
        b = self.bounds
        return (b.xmax - b.xmin) * (b.ymax - b.ymin)

    def contains(self, x_m: ArrayLike, y_m: ArrayLike) -> NDArray[np.bool_]:
        """Tell which points lie inside; left and lower edges belong to it, right and upper do not.

        Parameters
        ----------
        x_m, y_m : array_like of equal or broadcastable shape
            Metres, in the region's frame. A circle holds its rim; a polygon follows the even-odd rule.

        Raises
        ------
        InputError
            For a ``near`` that is not resolved.
        """
        x, y = np.broadcast_arrays(np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64))
        v = self.values
        if self.kind == "circle":
            return np.asarray((x - v[0]) ** 2 + (y - v[1]) ** 2 <= v[2] ** 2)
        if self.kind == "polygon":
            return _in_polygon(x, y, np.asarray(v[0::2]), np.asarray(v[1::2]))
        b = self.bounds
        return np.asarray((x >= b.xmin) & (x < b.xmax) & (y >= b.ymin) & (y < b.ymax))

    def mask(self, geometry: GridGeometry) -> NDArray[np.bool_]:
        """Cells ``(rows, cols)`` of a grid whose centre lies inside."""
        return self.contains(geometry.x_centres_m()[None, :], geometry.y_centres_m()[:, None])

    def coverage(self, geometry: GridGeometry, observed: NDArray[np.bool_]) -> float:
        """Share 0 to 1 of the region's cells that are observed.

        Parameters
        ----------
        geometry : GridGeometry
            A grid in the region's frame. Where it does not hold the whole region, the cells outside count as
            unobserved: their number is the region's area over a cell's.
        observed : NDArray[np.bool_], shape (rows, cols)
        """
        inside = self.mask(geometry)
        b, g = self.bounds, geometry.bounds
        whole = g.xmin <= b.xmin and g.ymin <= b.ymin and g.xmax >= b.xmax and g.ymax >= b.ymax
        total = float(np.count_nonzero(inside)) if whole else self.area_m2 / geometry.resolution_m**2
        hit = float(np.count_nonzero(inside & observed))
        return min(hit / total, 1.0) if total > 0.0 else 0.0

    def _unresolved(self) -> InputError:
        return InputError(f"region {self.text}: where {self.near_frame} is must be known first (resolved)")


def _numbers(text: str, fields: list[str], count: int) -> tuple[float, ...]:
    if len(fields) != count:
        raise InputError(f"region={text[:80]!r}: {len(fields)} numbers, expected {count}; forms are {_FORMS}")
    try:
        values = tuple(float(f) for f in fields)
    except ValueError as error:
        raise InputError(f"region={text[:80]!r}: {error}; forms are {_FORMS}") from error
    if not all(isfinite(v) for v in values):
        raise InputError(f"region={text[:80]!r}: expected finite numbers")
    return values


def _checked_radius(values: tuple[float, ...], text: str) -> tuple[float, ...]:
    if not values[0] > 0.0:
        raise InputError(f"region={text!r}: radius {values[0]}, expected metres above 0")
    return values


def _in_polygon(
    x: NDArray[np.float64], y: NDArray[np.float64], px: NDArray[np.float64], py: NDArray[np.float64]
) -> NDArray[np.bool_]:
    inside = np.zeros(x.shape, dtype=np.bool_)
    for x0, y0, x1, y1 in zip(px, py, np.roll(px, -1), np.roll(py, -1), strict=True):
        if y0 == y1:
            continue
        crosses = (y >= min(y0, y1)) & (y < max(y0, y1))
        inside ^= crosses & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return inside

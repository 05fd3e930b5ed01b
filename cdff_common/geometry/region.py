# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Regions as text and as geometry: containment, bounding boxes and area.

``bbox:xmin,ymin,xmax,ymax`` · ``box:xmin,ymin,zmin,xmax,ymax,zmax`` · ``circle:x,y,r`` ·
``polygon:x1,y1,x2,y2,…`` · ``path:d,x1,y1,x2,y2,…`` (within d of the line through the points) ·
``near:{frame},r``, metres in a frame that is given separately. ``near`` refers to a moving frame and becomes
a circle when its position is known (``resolved``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.geometry.frame_graph import checked_frame

#: Largest number of corners of a polygon or path in a query.
MAX_CORNERS = 1024
#: Number of boxes that cover a path.
MAX_PIECES = 64
_COUNTS = {"bbox": 4, "box": 6, "circle": 3}
_FORMS = (
    "bbox:xmin,ymin,xmax,ymax | box:xmin,ymin,zmin,xmax,ymax,zmax | circle:x,y,r | polygon:x1,y1,… | "
    "path:d,x1,y1,x2,y2,… | near:frame,r"
)


@dataclass(frozen=True, slots=True)
class Region:
    """Region of the x-y plane, or a box in space, in a frame given elsewhere.

    Attributes
    ----------
    kind : str
        ``bbox``, ``box``, ``circle``, ``polygon``, ``path`` or ``near``.
    values : tuple of float
        Numbers of the text, metres; for ``near`` only the radius, for ``path`` the distance first.
    near_frame : str or None
        Frame at the centre of ``near``.
    """

    kind: str
    values: tuple[float, ...]
    near_frame: str | None = None

    @property
    def text(self) -> str:
        """Region as text in a request."""
        head = [] if self.near_frame is None else [self.near_frame]
        return f"{self.kind}:" + ",".join([*head, *(f"{v:.9g}" for v in self.values)])

    @property
    def is_resolved(self) -> bool:
        """False for ``near``, whose position is not known yet."""
        return self.kind != "near"

    def resolved(self, x_m: float, y_m: float) -> Region:
        """Return the region with ``near`` replaced by a circle around the position of its frame."""
        return self if self.is_resolved else Region("circle", (float(x_m), float(y_m), self.values[0]))

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """``(xmin, ymin, xmax, ymax)``, metres."""
        self._check_resolved()
        v = self.values
        if self.kind == "bbox":
            return v[0], v[1], v[2], v[3]
        if self.kind == "box":
            return v[0], v[1], v[3], v[4]
        if self.kind == "circle":
            return v[0] - v[2], v[1] - v[2], v[0] + v[2], v[1] + v[2]
        if self.kind == "path":
            d, x, y = v[0], v[1::2], v[2::2]
            return min(x) - d, min(y) - d, max(x) + d, max(y) + d
        return min(v[0::2]), min(v[1::2]), max(v[0::2]), max(v[1::2])

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners ``(n, 2)`` of a polygon, or points of a path, metres; for other shapes those of their
        bounds.
        """
        if self.kind in ("polygon", "path"):
            return np.array(self.values[self.kind == "path" :]).reshape(-1, 2)
        x0, y0, x1, y1 = self.bounds
        return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])

    @property
    def centre(self) -> tuple[float, float]:
        """Centre of the bounds, metres; for a path its middle point."""
        if self.kind == "path":
            x, y = self.corners[len(self.corners) // 2]
            return float(x), float(y)
        x0, y0, x1, y1 = self.bounds
        return (x0 + x1) / 2.0, (y0 + y1) / 2.0

    @property
    def pieces(self) -> tuple[tuple[float, float, float, float, float, float], ...]:
        """Return boxes as ``box_m`` that cover the region together; for a path one per group of segments."""
        if self.kind != "path":
            return (self.box_m,)
        points, d = self.corners, self.values[0]
        step = -(-(len(points) - 1) // MAX_PIECES)
        parts = [points[i : i + step + 1] for i in range(0, len(points) - 1, step)]
        low, high = np.array([p.min(axis=0) for p in parts]) - d, np.array([p.max(axis=0) for p in parts]) + d
        return tuple(
            (float(x0), float(y0), -math.inf, float(x1), float(y1), math.inf)
            for (x0, y0), (x1, y1) in zip(low, high, strict=True)
        )

    @property
    def box_m(self) -> tuple[float, float, float, float, float, float]:
        """``(xmin, ymin, zmin, xmax, ymax, zmax)``, metres; z is unbounded except in a ``box``."""
        x0, y0, x1, y1 = self.bounds
        z0, z1 = (self.values[2], self.values[5]) if self.kind == "box" else (-math.inf, math.inf)
        return x0, y0, z0, x1, y1, z1

    @property
    def area_m2(self) -> float:
        """Area, square metres (shoelace area for a self-crossing polygon; including the round ends of a
        path).
        """
        v = self.values
        if self.kind == "path":
            import shapely

            return float(shapely.LineString(self.corners).buffer(v[0], quad_segs=64).area)
        if self.kind in ("circle", "near"):
            return math.pi * v[-1] ** 2
        if self.kind == "polygon":
            x, y = np.asarray(v[0::2]) - v[0], np.asarray(v[1::2]) - v[1]
            return float(abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2.0)
        x0, y0, x1, y1 = self.bounds
        return (x1 - x0) * (y1 - y0)

    def contains(self, x_m: ArrayLike, y_m: ArrayLike, z_m: ArrayLike | None = None) -> NDArray[np.bool_]:
        """Return whether points are inside; edges of boxes and circles are included.

        Parameters
        ----------
        x_m, y_m : array_like, any one shape
            Metres, in the region's frame.
        z_m : array_like, optional
            Used by ``box`` only.
        """
        self._check_resolved()
        x, y, v = np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64), self.values
        if self.kind == "circle":
            return np.asarray(np.hypot(x - v[0], y - v[1]) <= v[2])
        if self.kind == "polygon":
            return _in_polygon(x, y, self.corners)
        if self.kind == "path":
            return np.asarray(_distance_to_path(x, y, self.corners) <= v[0])
        x0, y0, z0, x1, y1, z1 = self.box_m
        inside = (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
        if self.kind == "box" and z_m is not None:
            z = np.asarray(z_m, dtype=np.float64)
            inside &= (z >= z0) & (z <= z1)
        return np.asarray(inside)

    def _check_resolved(self) -> None:
        if not self.is_resolved:
            raise InputError(f"region {self.text}: the position of {self.near_frame} must be resolved first")


def parse_region(text: str) -> Region:
    """Parse a region.

    Raises
    ------
    InputError
        If the form is unknown, the count of numbers is wrong, a number is not finite, or the region is empty.
    """
    kind, colon, arguments = text.partition(":")
    if not colon or kind not in {*_COUNTS, "polygon", "path", "near"}:
        raise InputError(f"region={text!r}: expected {_FORMS}")
    parts = arguments.split(",")
    near_frame = checked_frame(parts.pop(0), "region's frame") if kind == "near" else None
    try:
        values = tuple(float(p) for p in parts)
    except ValueError as error:
        raise InputError(f"region={text!r}: {error}; expected {_FORMS}") from error
    if not all(math.isfinite(v) for v in values):
        raise InputError(f"region={text!r}: contains numbers that are not finite")
    _check_numbers(text, kind, values)
    region = Region(kind, values, near_frame)
    if kind == "polygon" and not region.area_m2 > 0.0:
        raise InputError(f"region={text[:80]!r}: the polygon encloses no area")
    return region


def _check_numbers(text: str, kind: str, values: tuple[float, ...]) -> None:
    """Raise InputError if a region of this kind cannot have so many numbers."""
    count = 1 if kind == "near" else _COUNTS.get(kind)
    if count is not None and len(values) != count:
        raise InputError(f"region={text!r}: {len(values)} numbers, expected {count}")
    if kind == "polygon" and (len(values) % 2 or not 6 <= len(values) <= 2 * MAX_CORNERS):
        raise InputError(f"region={text!r}: expected x,y of 3 to {MAX_CORNERS} corners")
    if kind == "path" and (len(values) % 2 == 0 or not 5 <= len(values) <= 2 * MAX_CORNERS + 1):
        raise InputError(f"region={text[:80]!r}: expected a distance, then x,y of 2 to {MAX_CORNERS} points")
    if kind == "path" and values[0] <= 0:
        raise InputError(f"region={text[:80]!r}: distance {values[0]}, expected metres above 0")
    if kind in ("circle", "near") and values[-1] <= 0:
        raise InputError(f"region={text!r}: radius {values[-1]}, expected metres above 0")
    half = len(values) // 2
    if kind in ("bbox", "box") and any(
        low >= high for low, high in zip(values[:half], values[half:], strict=True)
    ):
        raise InputError(f"region={text!r}: expected each minimum below its maximum")


def _distance_to_path(
    x: NDArray[np.float64], y: NDArray[np.float64], vertices: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the distance of each (x, y) to the path through ``vertices``; one pass per segment."""
    nearest = np.full(np.broadcast_shapes(x.shape, y.shape), np.inf)
    for (x0, y0), (x1, y1) in pairwise(vertices):
        dx, dy = x1 - x0, y1 - y0
        length2 = dx * dx + dy * dy
        along = np.clip(((x - x0) * dx + (y - y0) * dy) / length2, 0.0, 1.0) if length2 > 0.0 else 0.0
        np.minimum(nearest, np.hypot(x - x0 - along * dx, y - y0 - along * dy), out=nearest)
    return nearest


def _in_polygon(
    x: NDArray[np.float64], y: NDArray[np.float64], corners: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return whether points are inside, by the even-odd rule; one pass per edge over all points."""
    inside = np.zeros(np.broadcast_shapes(x.shape, y.shape), dtype=bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 == y1:
            continue
        crosses = (y0 > y) != (y1 > y)
        inside ^= crosses & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return inside

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Regions of contract §6: the text that a requester writes, and which points lie inside.

``bbox:xmin,ymin,xmax,ymax`` | ``box:xmin,ymin,zmin,xmax,ymax,zmax`` | ``circle:x,y,r`` | ``polygon:x1,y1,…`` |
``near:{frame},r``, metres in a frame that is named beside the region. All but ``box`` leave z free.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.geometry.frame_graph import checked_frame

MAX_VERTICES = 1000
_COUNTS = {"bbox": 4, "box": 6, "circle": 3}
_FORMS = "bbox:xmin,ymin,xmax,ymax | box:xmin,ymin,zmin,xmax,ymax,zmax | circle:x,y,r | polygon:x1,y1,x2,y2,… | near:frame,r"


@dataclass(frozen=True, slots=True)
class Region:
    """A region in some frame.

    Attributes
    ----------
    kind : str
        bbox, box, circle, polygon or near.
    numbers : tuple of float
        As in the text, metres; for ``near`` the radius alone.
    centre_frame : str or None
        For ``near`` the frame whose origin is the centre.
    """

    kind: str
    numbers: tuple[float, ...]
    centre_frame: str | None = None

    def __post_init__(self) -> None:
        if not all(math.isfinite(v) for v in self.numbers):
            raise InputError(f"region {self}: expected finite numbers")
        _checked_shape(self)

    def __str__(self) -> str:
        values = ",".join(f"{v:.15g}" for v in self.numbers)
        return f"near:{self.centre_frame},{values}" if self.kind == "near" else f"{self.kind}:{values}"

    def around(self, centre_m: ArrayLike) -> Region:
        """Return the circle that ``near`` means once its frame's origin ``(2,) or (3,)`` is known; others themselves."""
        if self.kind != "near":
            return self
        c = np.asarray(centre_m, dtype=np.float64)
        return Region("circle", (float(c[0]), float(c[1]), self.numbers[0]))

    @property
    def bounds_m(self) -> tuple[float, float, float, float, float, float]:
        """``xmin ymin zmin xmax ymax zmax``; z infinite where it is free. Raises InputError for an unresolved ``near``."""
        n, inf = self.numbers, math.inf
        match self.kind:
            case "bbox":
                return (n[0], n[1], -inf, n[2], n[3], inf)
            case "box":
                return (n[0], n[1], n[2], n[3], n[4], n[5])
            case "circle":
                return (n[0] - n[2], n[1] - n[2], -inf, n[0] + n[2], n[1] + n[2], inf)
            case "polygon":
                return (min(n[0::2]), min(n[1::2]), -inf, max(n[0::2]), max(n[1::2]), inf)
        raise InputError(f"region {self}: its centre is not known yet; resolve it with around()")

    @property
    def vertices_m(self) -> NDArray[np.float64]:
        """Corners ``(n, 2)`` of the outline in the xy plane (none for a circle)."""
        if self.kind == "polygon":
            return np.array(self.numbers, dtype=np.float64).reshape(-1, 2)
        x0, y0, _, x1, y1, _ = self.bounds_m
        return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) if self.kind != "circle" else np.empty((0, 2))

    def contains(self, points_m: ArrayLike) -> NDArray[np.bool_]:
        """Tell which points ``(n, 2)`` or ``(n, 3)`` are inside; the border of a box or circle belongs to it."""
        p = np.asarray(points_m, dtype=np.float64)
        x, y = p[:, 0], p[:, 1]
        x0, y0, z0, x1, y1, z1 = self.bounds_m
        inside = (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
        if p.shape[1] > 2 and self.kind == "box":
            inside &= (p[:, 2] >= z0) & (p[:, 2] <= z1)
        if self.kind == "circle":
            inside &= (x - self.numbers[0]) ** 2 + (y - self.numbers[1]) ** 2 <= self.numbers[2] ** 2
        elif self.kind == "polygon":
            inside &= _in_polygon(self.vertices_m, x, y)
        return np.asarray(inside, dtype=np.bool_)

    def overlaps_box(self, box_m: Sequence[float]) -> bool:
        """Tell whether an axis-aligned box (6 numbers, same frame) shares a point with the region's outline box."""
        b = self.bounds_m
        return all(box_m[i] <= b[i + 3] and box_m[i + 3] >= b[i] for i in range(3))


def parse_region(text: str) -> Region:
    """Parse the text of a region.

    Raises
    ------
    InputError
        On an unknown form, a wrong count of numbers, values that are not finite, an empty or self-crossing shape.
    """
    kind, separator, rest = text.partition(":")
    if not separator or (kind not in _COUNTS and kind not in ("polygon", "near")):
        raise InputError(f"region={text[:80]!r}: expected {_FORMS}")
    fields = rest.split(",")
    if len(fields) > 2 * MAX_VERTICES:
        raise InputError(f"region={kind}: {len(fields)} numbers, expected at most {2 * MAX_VERTICES}")
    centre = None
    if kind == "near":
        if len(fields) != 2:
            raise InputError(f"region={text[:80]!r}: expected near:frame,radius")
        centre, fields = checked_frame(fields[0], "near"), fields[1:]
    try:
        numbers = tuple(float(f) for f in fields)
    except ValueError as error:
        raise InputError(f"region={text[:80]!r}: {error}; expected {_FORMS}") from error
    return Region(kind, numbers, centre)


def _checked_shape(region: Region) -> None:
    kind, n = region.kind, region.numbers
    problem = ""
    if kind in _COUNTS and len(n) != _COUNTS[kind]:
        problem = f"{len(n)} numbers, expected {_COUNTS[kind]}"
    elif kind == "bbox" and not (n[0] < n[2] and n[1] < n[3]):
        problem = "expected xmin < xmax and ymin < ymax"
    elif kind == "box" and not (n[0] < n[3] and n[1] < n[4] and n[2] < n[5]):
        problem = "expected each minimum below its maximum"
    elif kind in ("circle", "near") and not n[-1] > 0:
        problem = "expected a radius above 0"
    elif kind == "near" and (region.centre_frame is None or len(n) != 1):
        problem = "expected a frame and a radius"
    elif kind == "polygon":
        problem = _polygon_problem(n)
    elif kind not in _COUNTS and kind != "near":
        problem = f"unknown kind, expected {_FORMS}"
    if problem:
        raise InputError(f"region={str(region)[:120]}: {problem}")


def _polygon_problem(numbers: Sequence[float]) -> str:
    if len(numbers) % 2 or not 6 <= len(numbers) <= 2 * MAX_VERTICES:
        return f"{len(numbers)} numbers, expected 3 to {MAX_VERTICES} pairs"
    p = np.array(numbers).reshape(-1, 2)
    q = np.roll(p, -1, axis=0)
    if np.any(np.all(p == q, axis=1)):
        return "expected no repeated vertex (the outline closes by itself)"
    # Edge i crosses edge j when the ends of each lie on opposite sides of the other; neighbours share a vertex.
    side_start = _cross(q[:, None] - p[:, None], p[None] - p[:, None])
    side_end = _cross(q[:, None] - p[:, None], q[None] - p[:, None])
    opposite = side_start * side_end < 0
    if np.any(opposite & opposite.T):
        return "the outline crosses itself"
    return "" if abs(float(np.sum(_cross(p, q)))) > 0 else "the outline encloses nothing"


def _cross(a: Any, b: Any) -> NDArray[np.float64]:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0], dtype=np.float64)


def _in_polygon(vertices: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
    inside = np.zeros(x.shape, dtype=np.bool_)
    for (xa, ya), (xb, yb) in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        if ya == yb:
            continue
        straddles = (ya > y) != (yb > y)
        inside ^= straddles & (x < (xb - xa) * (y - ya) / (yb - ya) + xa)
    return inside

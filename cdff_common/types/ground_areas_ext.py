# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of areas of the ground."""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.types.columns import check_columns
from cdff_common.types.message import Box, Message
from cdff_common.types.time import Time

if TYPE_CHECKING:
    from cdff_common.types.ground_areas import GroundAreas, GroundAreasData, GroundAreasMetadata


class AreaKind(IntEnum):
    """What a rover may do in an area: the classes of a navigation map, and two that join them."""

    UNKNOWN = 0
    SAFE = 1
    CAUTION = 2
    HAZARD = 3
    PASSABLE = 4
    BLOCKED = 5


class GroundAreasDataExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        kinds: NDArray[np.uint8]
        areas: NDArray[np.float64]
        ring_counts: NDArray[np.uint32]
        corner_counts: NDArray[np.uint32]
        corners: NDArray[np.float64]

    def _check_together(self) -> None:
        """Kinds that are known, an outer ring for each area, and as many rings and corners as are counted."""
        columns: dict[str, NDArray[Any]] = {"areas": self.areas, "ring_counts": self.ring_counts}
        check_columns("GroundAreasData", len(self.kinds), columns, {})
        check_columns("GroundAreasData", int(self.ring_counts.sum()), {"corner_counts": self.corner_counts}, {})
        check_columns("GroundAreasData", int(self.corner_counts.sum()), {"corners": self.corners}, {})
        for name, least, values in (("ring_counts", 1, self.ring_counts), ("corner_counts", 3, self.corner_counts)):
            if (values < least).any():
                raise InputError(f"GroundAreasData.{name}: {values.min()}, expected {least} at least")
        if (self.kinds > max(AreaKind)).any():
            raise InputError(f"GroundAreasData.kinds: {self.kinds.max()}, expected 0 to {max(AreaKind)}")


class GroundAreasExt(Message):
    """Polygons in one frame."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: GroundAreasMetadata
        data: GroundAreasData

    @classmethod
    def from_rings(
        cls,
        kinds: ArrayLike,
        ring_counts: ArrayLike,
        corner_counts: ArrayLike,
        corners_m: ArrayLike,
        *,
        frame: str,
        t0_ns: int,
        t1_ns: int,
        resolution_m: float = 0.0,
        tolerance_m: float = 0.0,
        producer: str = "",
    ) -> GroundAreas:
        """Areas of rings one after another; how large each is follows from them.

        Parameters
        ----------
        kinds : array_like of int, shape (n,)
            ``AreaKind`` of each area.
        ring_counts : array_like of int, shape (n,)
            Rings of each area: its outer one, counter-clockwise, and its holes, clockwise.
        corner_counts : array_like of int, shape (r,)
            Corners of each ring.
        corners_m : array_like, shape (c, 2)
            x y in ``frame``; the first of a ring is not repeated at its end.

        Raises
        ------
        InputError
            On counts that do not fit to what they count, or a kind that is none.
        """
        from cdff_common.types.ground_areas import GroundAreas, GroundAreasData, GroundAreasMetadata

        rings, counts = np.asarray(ring_counts, dtype=np.uint32), np.asarray(corner_counts, dtype=np.uint32)
        corners = np.asarray(corners_m, dtype=np.float64).reshape(-1, 2)
        check_columns("GroundAreas", int(counts.sum()), {"corners": corners}, {})
        check_columns("GroundAreas", int(rings.sum()), {"corner_counts": counts}, {})
        data = GroundAreasData(
            np.asarray(kinds, dtype=np.uint8), _areas_m2(rings, counts, corners), rings, counts, corners
        )
        metadata = GroundAreasMetadata(
            producer_id=producer,
            frame_id=frame,
            start_time=Time.from_ns(t0_ns),
            end_time=Time.from_ns(t1_ns),
            resolution=resolution_m,
            tolerance=tolerance_m,
        )
        return GroundAreas(metadata, data)

    @property
    def frame(self) -> str:
        """Frame of the corners."""
        return self.metadata.frame_id

    @property
    def t0_ns(self) -> int:
        """Begin of capture, nanoseconds."""
        return self.metadata.start_time.ns

    @property
    def t1_ns(self) -> int:
        """End of capture, nanoseconds."""
        return self.metadata.end_time.ns

    @property
    def stamp_ns(self) -> int:
        """End of capture, nanoseconds."""
        return self.t1_ns

    @property
    def polygons(self) -> list[list[NDArray[np.float64]]]:
        """Of each area its rings ``(k, 2)``, the outer one first."""
        rings = np.split(self.data.corners, np.cumsum(self.data.corner_counts, dtype=np.int64)[:-1])
        ends = np.cumsum(self.data.ring_counts, dtype=np.int64)
        return [
            rings[end - count : end] for end, count in zip(ends, self.data.ring_counts.astype(np.int64), strict=True)
        ]

    def extent_m(self) -> Box | None:
        """Box around the corners, z 0."""
        if not len(self.data.corners):
            return None
        (x0, y0), (x1, y1) = self.data.corners.min(axis=0).tolist(), self.data.corners.max(axis=0).tolist()
        return (x0, y0, 0.0, x1, y1, 0.0)


def _areas_m2(
    ring_counts: NDArray[np.uint32], corner_counts: NDArray[np.uint32], corners: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Sum of the signed areas of the rings of each area (shoelace formula); holes, clockwise, count below 0."""
    ring = np.repeat(np.arange(len(corner_counts)), corner_counts)
    area = np.repeat(np.arange(len(ring_counts)), ring_counts)
    begin = np.cumsum(corner_counts, dtype=np.int64) - corner_counts
    # About the ring's first corner, so that rings far from the origin lose no digits.
    x, y = (corners - corners[begin[ring]]).T
    following = np.arange(1, len(ring) + 1)
    last = begin + corner_counts - 1
    following[last] = begin
    doubled = np.bincount(ring, x * y[following] - x[following] * y, minlength=len(corner_counts))
    return np.asarray(0.5 * np.bincount(area, doubled, minlength=len(ring_counts)), dtype=np.float64)

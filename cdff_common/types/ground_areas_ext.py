# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of ground areas."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.types.message import Box, Message, box_around, check_columns


class AreaKind(IntEnum):
    """Traversability of an area: the classes of a navigation map, and two combinations."""

    UNKNOWN = 0
    SAFE = 1
    CAUTION = 2
    HAZARD = 3
    PASSABLE = 4
    BLOCKED = 5


class GroundAreasDataExt(Message):
    """One row per area, one corner count per ring."""

    __slots__ = ()
    kinds: NDArray[np.uint8]
    ring_counts: NDArray[np.uint32]
    corner_counts: NDArray[np.uint32]
    corners: NDArray[np.float64]

    def _check_consistency(self) -> None:
        """Check the kinds, the outer ring of each area, and the numbers of rings and corners."""
        Message._check_consistency(self)
        check_columns("GroundAreasData", int(self.ring_counts.sum()), {"corner_counts": self.corner_counts})
        check_columns("GroundAreasData", int(self.corner_counts.sum()), {"corners": self.corners})
        for name, least, values in (
            ("ring_counts", 1, self.ring_counts),
            ("corner_counts", 3, self.corner_counts),
        ):
            if (values < least).any():
                raise InputError(f"GroundAreasData.{name}: {values.min()}, expected at least {least}")
        if (self.kinds > max(AreaKind)).any():
            raise InputError(f"GroundAreasData.kinds: {self.kinds.max()}, expected 0 to {max(AreaKind)}")


class GroundAreasExt(Message):
    """Polygons in one frame."""

    __slots__ = ()
    metadata: types.GroundAreasMetadata
    data: types.GroundAreasData

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
    ) -> types.GroundAreas:
        """Return the areas of consecutive rings; their sizes are computed.

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
            If counts are inconsistent, or a kind is unknown.
        """
        rings, counts = np.asarray(ring_counts, dtype=np.uint32), np.asarray(corner_counts, dtype=np.uint32)
        corners = np.asarray(corners_m, dtype=np.float64).reshape(-1, 2)
        check_columns("GroundAreas", int(counts.sum()), {"corners": corners})
        check_columns("GroundAreas", int(rings.sum()), {"corner_counts": counts})
        data = types.GroundAreasData(
            np.asarray(kinds, dtype=np.uint8), _areas_m2(rings, counts, corners), rings, counts, corners
        )
        metadata = types.GroundAreasMetadata(
            producer_id=producer,
            frame_id=frame,
            start_time=types.Time.from_ns(t0_ns),
            end_time=types.Time.from_ns(t1_ns),
            resolution=resolution_m,
            tolerance=tolerance_m,
        )
        return types.GroundAreas(metadata, data)

    @property
    def polygons(self) -> list[list[NDArray[np.float64]]]:
        """Return the rings ``(k, 2)`` of each area, the outer one first."""
        rings = np.split(self.data.corners, np.cumsum(self.data.corner_counts, dtype=np.int64)[:-1])
        ends = np.cumsum(self.data.ring_counts, dtype=np.int64)
        return [
            rings[end - count : end]
            for end, count in zip(ends, self.data.ring_counts.astype(np.int64), strict=True)
        ]

    def extent_m(self) -> Box | None:
        """Return the box around the corners, z 0."""
        return box_around(np.pad(self.data.corners, ((0, 0), (0, 1))))


def _areas_m2(
    ring_counts: NDArray[np.uint32], corner_counts: NDArray[np.uint32], corners: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the signed sum of the ring areas of each area (shoelace formula); holes are negative."""
    ring = np.repeat(np.arange(len(corner_counts)), corner_counts)
    area = np.repeat(np.arange(len(ring_counts)), ring_counts)
    begin = np.cumsum(corner_counts, dtype=np.int64) - corner_counts
    # Relative to the ring's first corner, to avoid cancellation far from the origin.
    x, y = (corners - corners[begin[ring]]).T
    following = np.arange(1, len(ring) + 1)
    last = begin + corner_counts - 1
    following[last] = begin
    doubled = np.bincount(ring, x * y[following] - x[following] * y, minlength=len(corner_counts))
    return np.asarray(0.5 * np.bincount(area, doubled, minlength=len(ring_counts)), dtype=np.float64)

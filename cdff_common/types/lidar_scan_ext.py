# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of a lidar sweep."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.types.message import Message


class LidarScanExt(Message):
    """Lidar sweep: each point in the sensor frame at its own time stamp."""

    __slots__ = ()
    metadata: types.LidarScanMetadata
    data: types.LidarScanData

    @classmethod
    def from_arrays(
        cls,
        points_m: ArrayLike,
        time_offset_us: ArrayLike,
        *,
        frame: str,
        t0_ns: int,
        t1_ns: int,
        intensity: ArrayLike | None = None,
        ring: ArrayLike | None = None,
        sensor: str = "",
    ) -> types.LidarScan:
        """Return a sweep of points ``(n, 3)``, metres (float32), each ``time_offset_us`` after ``t0_ns``.

        Raises
        ------
        InputError
            If array lengths differ, an offset lies after ``t1_ns``, or ``t1_ns < t0_ns``.
        """
        offsets = np.asarray(time_offset_us)
        if t1_ns < t0_ns:
            raise InputError(f"LidarScan: t0 {t0_ns}, t1 {t1_ns}: expected t0 <= t1")
        if offsets.size and int(offsets.max()) * 1000 > t1_ns - t0_ns:
            raise InputError(
                f"LidarScan: offset {int(offsets.max())} us lies after t1, {(t1_ns - t0_ns) // 1000} us"
            )
        data = types.LidarScanData(
            np.asarray(points_m, dtype=np.float32),
            offsets,
            np.zeros(0, np.uint16) if intensity is None else np.asarray(intensity),
            np.zeros(0, np.uint16) if ring is None else np.asarray(ring),
        )
        metadata = types.LidarScanMetadata(
            sensor_id=sensor,
            frame_id=frame,
            start_time=types.Time.from_ns(t0_ns),
            end_time=types.Time.from_ns(t1_ns),
        )
        return types.LidarScan(metadata, data)

    @property
    def points_m(self) -> NDArray[np.float32]:
        """Points ``(n, 3)``, metres, each in ``frame`` at its own time."""
        return self.data.points

    @property
    def time_offset_us(self) -> NDArray[np.uint32]:
        """Microseconds ``(n,)`` after ``t0_ns``."""
        return self.data.time_offsets

    @property
    def intensity(self) -> NDArray[np.uint16] | None:
        """Intensities ``(n,)``; None where the scan has none."""
        return self.data.intensity if len(self.data.intensity) or not len(self.data.points) else None

    @property
    def ring(self) -> NDArray[np.uint16] | None:
        """Laser numbers ``(n,)``; None where the scan has none."""
        return self.data.ring if len(self.data.ring) or not len(self.data.points) else None

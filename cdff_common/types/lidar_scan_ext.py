# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of a lidar sweep."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.types.message import Box, Message
from cdff_common.types.pointcloud_ext import box_of_points
from cdff_common.types.time import Time

if TYPE_CHECKING:
    from cdff_common.types.lidar_scan import LidarScan, LidarScanData, LidarScanMetadata


class LidarScanDataExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        points: NDArray[np.float32]
        time_offsets: NDArray[np.uint32]
        intensity: NDArray[np.uint16]
        ring: NDArray[np.uint16]

    def _check_together(self) -> None:
        """One time for each point; intensities and rings are none, or one for each point."""
        n = len(self.points)
        if len(self.time_offsets) != n:
            raise InputError(f"LidarScanData.time_offsets: {len(self.time_offsets)} for {n} points, expected as many")
        for name, array in (("intensity", self.intensity), ("ring", self.ring)):
            if len(array) not in (0, n):
                raise InputError(f"LidarScanData.{name}: {len(array)} for {n} points, expected 0 or as many")


class LidarScanExt(Message):
    """One sweep: each point in the sensor's frame at the point's own time."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: LidarScanMetadata
        data: LidarScanData

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
    ) -> LidarScan:
        """Sweep of points ``(n, 3)`` in metres (kept as float32), each ``time_offset_us`` after ``t0_ns``.

        Raises
        ------
        InputError
            On sizes that differ, offsets beyond ``t1_ns``, or a sweep that ends before it begins.
        """
        from cdff_common.types.lidar_scan import LidarScan, LidarScanData, LidarScanMetadata

        offsets = np.asarray(time_offset_us)
        if t1_ns < t0_ns:
            raise InputError(f"LidarScan: t0 {t0_ns}, t1 {t1_ns}: expected t0 <= t1")
        if offsets.size and int(offsets.max()) * 1000 > t1_ns - t0_ns:
            raise InputError(f"LidarScan: offset {int(offsets.max())} us lies after t1, {(t1_ns - t0_ns) // 1000} us")
        data = LidarScanData(
            np.asarray(points_m, dtype=np.float32),
            offsets,
            np.zeros(0, np.uint16) if intensity is None else np.asarray(intensity),
            np.zeros(0, np.uint16) if ring is None else np.asarray(ring),
        )
        metadata = LidarScanMetadata(
            sensor_id=sensor, frame_id=frame, start_time=Time.from_ns(t0_ns), end_time=Time.from_ns(t1_ns)
        )
        return LidarScan(metadata, data)

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

    @property
    def frame(self) -> str:
        """Frame of the points."""
        return self.metadata.frame_id

    @property
    def t0_ns(self) -> int:
        """Begin of the sweep, nanoseconds."""
        return self.metadata.start_time.ns

    @property
    def t1_ns(self) -> int:
        """End of the sweep, nanoseconds."""
        return self.metadata.end_time.ns

    @property
    def stamp_ns(self) -> int:
        """End of the sweep, nanoseconds."""
        return self.t1_ns

    def extent_m(self) -> Box | None:
        """Box around the finite points in ``frame``, as if they were taken at one time."""
        return box_of_points(self.data.points)

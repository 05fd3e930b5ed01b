# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/lidar_scan.asn by cdff generate; do not edit.

"""Types of ``asn1/lidar_scan.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.lidar_scan_ext import LidarScanExt
from cdff_common.types.message import CapturedMessage, Message
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LidarScanMetadata(Message):
    """Type ``LidarScan-Metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    sensor_id : str, at most 256 bytes
    frame_id : str, at most 256 bytes
        frame of the points, each at its own time stamp.
    start_time : Time
        t0: origin of the time offsets.
    end_time : Time
        t1: end of the sweep.
    """

    ASN1_NAME: ClassVar[str] = "LidarScan-Metadata"
    msg_version: int = 1
    sensor_id: str = ""
    frame_id: str = ""
    start_time: Time = field(default_factory=Time)
    end_time: Time = field(default_factory=Time)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.end_time.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LidarScanData(Message):
    """Columns of equal length: one row per point.

    Attributes
    ----------
    points : NDArray[np.float32], shape (n, 3)
        m, x y z.
    time_offsets : NDArray[np.uint32], shape (n,)
        us after startTime, one per point.
    intensity : NDArray[np.uint16], shape (n,)
        none or one per point.
    ring : NDArray[np.uint16], shape (n,)
        laser number; none or one per point.
    """

    ASN1_NAME: ClassVar[str] = "LidarScan-Data"
    points: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    time_offsets: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    intensity: NDArray[np.uint16] = field(default_factory=lambda: np.zeros(0, np.uint16))
    ring: NDArray[np.uint16] = field(default_factory=lambda: np.zeros(0, np.uint16))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LidarScan(LidarScanExt, CapturedMessage):
    """Lidar sweep; each point has its own time stamp.

    Attributes
    ----------
    metadata : LidarScanMetadata
    data : LidarScanData
    """

    ASN1_NAME: ClassVar[str] = "LidarScan"
    metadata: LidarScanMetadata = field(default_factory=LidarScanMetadata)
    data: LidarScanData = field(default_factory=LidarScanData)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/lidar_scan.asn by cdff generate; do not edit.

"""Types of ``asn1/lidar_scan.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.lidar_scan_ext import LidarScanDataExt, LidarScanExt
from cdff_common.types.message import Message
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LidarScanMetadata(Message):
    """What a ``LidarScan-Metadata`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    sensor_id : str, at most 256 octets
    frame_id : str, at most 256 octets
        frame of the points, each at its own time.
    start_time : Time
        t0: zero of the time offsets.
    end_time : Time
        t1: end of the sweep.
    """

    ASN1_NAME: ClassVar[str] = "LidarScan-Metadata"
    msg_version: int = 1
    sensor_id: str = ""
    frame_id: str = ""
    start_time: Time = field(default_factory=Time)
    end_time: Time = field(default_factory=Time)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "LidarScanMetadata.msg_version", 0, 4294967295))
        put(self, "sensor_id", check.text(self.sensor_id, "LidarScanMetadata.sensor_id", 256))
        put(self, "frame_id", check.text(self.frame_id, "LidarScanMetadata.frame_id", 256))
        put(self, "start_time", check.instance(self.start_time, "LidarScanMetadata.start_time", Time))
        put(self, "end_time", check.instance(self.end_time, "LidarScanMetadata.end_time", Time))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LidarScanData(LidarScanDataExt):
    """Columns of one length: one row for each point.

    Attributes
    ----------
    points : NDArray[np.float32], shape (n, 3)
        m, x y z.
    time_offsets : NDArray[np.uint32], shape (n,)
        us after startTime, one for each point.
    intensity : NDArray[np.uint16], shape (n,)
        none or one for each point.
    ring : NDArray[np.uint16], shape (n,)
        laser number; none or one for each point.
    """

    ASN1_NAME: ClassVar[str] = "LidarScan-Data"
    points: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 3), np.float32))
    time_offsets: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    intensity: NDArray[np.uint16] = field(default_factory=lambda: np.zeros(0, np.uint16))
    ring: NDArray[np.uint16] = field(default_factory=lambda: np.zeros(0, np.uint16))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "points", check.typed_octets(self.points, "LidarScanData.points", 1073741824, "<f4", 3))
        put(
            self,
            "time_offsets",
            check.typed_octets(self.time_offsets, "LidarScanData.time_offsets", 1073741824, "<u4", 0),
        )
        put(self, "intensity", check.typed_octets(self.intensity, "LidarScanData.intensity", 1073741824, "<u2", 0))
        put(self, "ring", check.typed_octets(self.ring, "LidarScanData.ring", 1073741824, "<u2", 0))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LidarScan(LidarScanExt):
    """A sweep; each point has its own time.

    Attributes
    ----------
    metadata : LidarScanMetadata
    data : LidarScanData
    """

    ASN1_NAME: ClassVar[str] = "LidarScan"
    metadata: LidarScanMetadata = field(default_factory=LidarScanMetadata)
    data: LidarScanData = field(default_factory=LidarScanData)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "LidarScan.metadata", LidarScanMetadata))
        put(self, "data", check.instance(self.data, "LidarScan.data", LidarScanData))
        self._check_together()

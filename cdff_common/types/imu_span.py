# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/imu_span.asn by cdff generate; do not edit.

"""Types of ``asn1/imu_span.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.imu_span_ext import ImuSpanDataExt, ImuSpanExt
from cdff_common.types.message import Message


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ImuSpanMetadata(Message):
    """What an ``ImuSpan-Metadata`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    sensor_id : str, at most 256 octets
        frame of the sensor.
    """

    ASN1_NAME: ClassVar[str] = "ImuSpan-Metadata"
    msg_version: int = 1
    sensor_id: str = ""

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "ImuSpanMetadata.msg_version", 0, 4294967295))
        put(self, "sensor_id", check.text(self.sensor_id, "ImuSpanMetadata.sensor_id", 256))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ImuSpanData(ImuSpanDataExt):
    """Columns of one length: one row for each measurement.

    Attributes
    ----------
    stamps : NDArray[np.int64], shape (n,)
        us since the UNIX epoch, rising.
    acc : NDArray[np.float64], shape (n, 3)
        m/s2, specific force: +9.81 upwards at rest.
    gyro : NDArray[np.float64], shape (n, 3)
        rad/s.
    mag : NDArray[np.float64], shape (n, 3)
        uT, or normalised where the sensor says so.
    """

    ASN1_NAME: ClassVar[str] = "ImuSpan-Data"
    stamps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    acc: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    gyro: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    mag: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "stamps", check.typed_octets(self.stamps, "ImuSpanData.stamps", 1073741824, "<i8", 0))
        put(self, "acc", check.typed_octets(self.acc, "ImuSpanData.acc", 1073741824, "<f8", 3))
        put(self, "gyro", check.typed_octets(self.gyro, "ImuSpanData.gyro", 1073741824, "<f8", 3))
        put(self, "mag", check.typed_octets(self.mag, "ImuSpanData.mag", 1073741824, "<f8", 3))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ImuSpan(ImuSpanExt):
    """Calibrated inertial measurements of one sensor at rising times.

    Attributes
    ----------
    metadata : ImuSpanMetadata
    data : ImuSpanData
    """

    ASN1_NAME: ClassVar[str] = "ImuSpan"
    metadata: ImuSpanMetadata = field(default_factory=ImuSpanMetadata)
    data: ImuSpanData = field(default_factory=ImuSpanData)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "ImuSpan.metadata", ImuSpanMetadata))
        put(self, "data", check.instance(self.data, "ImuSpan.data", ImuSpanData))
        self._check_together()

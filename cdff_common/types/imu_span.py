# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/imu_span.asn by cdff generate; do not edit.

"""Types of ``asn1/imu_span.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.imu_span_ext import ImuSpanExt
from cdff_common.types.message import Message


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ImuSpanMetadata(Message):
    """Type ``ImuSpan-Metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    sensor_id : str, at most 256 bytes
        frame of the sensor.
    """

    ASN1_NAME: ClassVar[str] = "ImuSpan-Metadata"
    msg_version: int = 1
    sensor_id: str = ""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ImuSpanData(Message):
    """Columns of equal length: one row per measurement.

    Attributes
    ----------
    stamps : NDArray[np.int64], shape (n,)
        us since the UNIX epoch, ascending.
    acc : NDArray[np.float64], shape (n, 3)
        m/s2, specific force: +9.81 upwards at rest.
    gyro : NDArray[np.float64], shape (n, 3)
        rad/s.
    mag : NDArray[np.float64], shape (n, 3)
        uT, or normalised if the sensor is specified so.
    """

    ASN1_NAME: ClassVar[str] = "ImuSpan-Data"
    stamps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    acc: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    gyro: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    mag: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ImuSpan(ImuSpanExt):
    """Calibrated inertial measurements of one sensor, in ascending order of time.

    Attributes
    ----------
    metadata : ImuSpanMetadata
    data : ImuSpanData
    """

    ASN1_NAME: ClassVar[str] = "ImuSpan"
    metadata: ImuSpanMetadata = field(default_factory=ImuSpanMetadata)
    data: ImuSpanData = field(default_factory=ImuSpanData)

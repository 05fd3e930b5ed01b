# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of inertial measurements of a span of time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.types.columns import check_columns, stamps_us
from cdff_common.types.message import Message

if TYPE_CHECKING:
    from cdff_common.types.imu_span import ImuSpan, ImuSpanData, ImuSpanMetadata
    from cdff_common.types.joints import IMUSensors


class ImuSpanDataExt(Message):
    """Sizes that belong together."""

    __slots__ = ()
    if TYPE_CHECKING:
        stamps: NDArray[np.int64]
        acc: NDArray[np.float64]
        gyro: NDArray[np.float64]
        mag: NDArray[np.float64]

    def _check_together(self) -> None:
        """One row of each for each stamp; rising stamps."""
        whole: dict[str, NDArray[Any]] = {"acc": self.acc, "gyro": self.gyro, "mag": self.mag}
        check_columns("ImuSpanData", len(self.stamps), whole, {})
        if len(self.stamps) > 1 and not (np.diff(self.stamps) > 0).all():
            raise InputError("ImuSpanData.stamps: expected rising stamps")


class ImuSpanExt(Message):
    """Measurements of one sensor at rising times."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: ImuSpanMetadata
        data: ImuSpanData

    @classmethod
    def from_samples(cls, samples: Sequence[IMUSensors], *, frame: str) -> ImuSpan:
        """A span of samples, in the order of their stamps; of equal stamps the first is taken.

        Parameters
        ----------
        frame : str
            Of the sensor.
        """
        from cdff_common.types.imu_span import ImuSpan, ImuSpanData, ImuSpanMetadata

        by_stamp: dict[int, IMUSensors] = {}
        for sample in samples:
            by_stamp.setdefault(sample.stamp_ns, sample)
        rows = [by_stamp[stamp_ns] for stamp_ns in sorted(by_stamp)]
        columns = (np.array([getattr(row, name) for row in rows]).reshape(-1, 3) for name in ("acc", "gyro", "mag"))
        stamps = stamps_us([row.stamp_ns for row in rows], "ImuSpan stamps")
        return ImuSpan(ImuSpanMetadata(sensor_id=frame), ImuSpanData(stamps, *columns))

    @property
    def frame(self) -> str:
        """Frame of the sensor."""
        return self.metadata.sensor_id

    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Times ``(n,)``, nanoseconds."""
        return self.data.stamps * 1000

    @property
    def stamp_ns(self) -> int:
        """Time of the last measurement, nanoseconds; 0 without any."""
        return int(self.data.stamps[-1]) * 1000 if len(self.data.stamps) else 0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of inertial measurements of a time interval."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cdff_common import types
from cdff_common.types.columns import stamps_us
from cdff_common.types.message import Message


class ImuSpanExt(Message):
    """Measurements of one sensor with ascending stamps."""

    __slots__ = ()
    metadata: types.ImuSpanMetadata
    data: types.ImuSpanData

    @classmethod
    def from_samples(cls, samples: Sequence[types.IMUSensors], *, frame: str) -> types.ImuSpan:
        """Return the measurements of samples, sorted by stamp; the first of equal stamps is used.

        Parameters
        ----------
        frame : str
            Frame of the sensor.
        """
        by_stamp: dict[int, types.IMUSensors] = {}
        for sample in samples:
            by_stamp.setdefault(sample.stamp_ns, sample)
        rows = [by_stamp[stamp_ns] for stamp_ns in sorted(by_stamp)]
        columns = (
            np.array([getattr(row, name) for row in rows]).reshape(-1, 3) for name in ("acc", "gyro", "mag")
        )
        stamps = stamps_us([row.stamp_ns for row in rows], "ImuSpan stamps")
        return types.ImuSpan(types.ImuSpanMetadata(sensor_id=frame), types.ImuSpanData(stamps, *columns))

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
        """Time of the last measurement, nanoseconds; 0 if there is none."""
        return int(self.data.stamps[-1]) * 1000 if len(self.data.stamps) else 0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A log that is repeated without end: each lap continues the time and the odometry."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import product_id
from cdff_common.types import Time, TransformWithCovariance
from cdff_dev.logs import LogSample, LogSource, StreamInfo
from cdff_dev.logs.source import Unconverted, split_stream

#: Laps that a player may expect: thirty years of one minute each.
_LAPS = 1 << 24


class LoopedLog(LogSource):
    """A log whose last sample is followed by its first one, at later times.

    Poses of wheel odometry are multiplied by the motion of the previous laps, because odometry does not
    return to its start. All other samples repeat, also if the robot does not return to its start.

    Raises InputError for a log without samples.
    """

    def __init__(self, log: LogSource) -> None:
        self._log = log
        infos = [info for info in log.streams.values() if not info.is_empty]
        if not infos:
            raise InputError("a log without samples cannot be repeated")
        spacings_ns = [(i.t1_ns - i.t0_ns) // (i.count - 1) for i in infos if i.count > 1]
        # The first sample of a lap follows the last one of the lap before after the shortest period.
        step_ns = max(min(spacings_ns, default=0) // 1000 * 1000, 1000)
        self._period_ns = max(i.t1_ns for i in infos) - min(i.t0_ns for i in infos) + step_ns
        self._T_lap: dict[str, UncertainTransform] = {}

    @property
    def streams(self) -> dict[str, StreamInfo]:
        """Streams by name; their end is that of the last possible lap."""
        return {
            name: dataclasses.replace(info, t1_ns=info.t1_ns + _LAPS * self._period_ns)
            for name, info in self._log.streams.items()
        }

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """Content without a stream."""
        return self._log.unconverted

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples of lap after lap."""
        counts = {name: info.count for name, info in self._log.streams.items()}
        for lap in range(_LAPS):
            newest: dict[str, Any] = {}
            for sample in self._log.samples(streams):
                is_odometry = sample.stream.endswith("/wheels.odometry")
                if is_odometry:
                    newest[sample.stream] = sample.value
                value = self._continued(sample) if is_odometry else sample.value
                yield self._later(sample, value, lap, counts[sample.stream])
            for stream, last in newest.items():
                done = self._T_lap.get(stream)
                self._T_lap[stream] = last.transform if done is None else done @ last.transform

    def close(self) -> None:
        """Close the files."""
        self._log.close()

    def _continued(self, sample: LogSample) -> TransformWithCovariance:
        """Return a pose of odometry after the motion of the previous laps."""
        pose: TransformWithCovariance = sample.value
        done = self._T_lap.get(sample.stream)
        if done is None:
            return pose
        moved = TransformWithCovariance.from_transform(
            done @ pose.transform, parent="", child="", stamp_ns=sample.stamp_ns
        )
        return dataclasses.replace(pose, data=moved.data)

    def _later(self, sample: LogSample, value: Any, lap: int, count: int) -> LogSample:
        shift_ns = lap * self._period_ns
        stamp_ns, seq = sample.stamp_ns + shift_ns, sample.seq + lap * count
        header = sample.header
        if header is not None:
            header = dataclasses.replace(
                header,
                id=product_id(*split_stream(sample.stream), stamp_ns, seq, ""),
                seq=seq,
                t0_ns=header.t0_ns + shift_ns,
                t1_ns=header.t1_ns + shift_ns,
            )
        return dataclasses.replace(
            sample, stamp_ns=stamp_ns, seq=seq, value=_shifted(value, shift_ns // 1000), header=header
        )


def _shifted(value: Any, shift_us: int) -> Any:
    """Return a message with all its times later; an unset time stays."""
    if isinstance(value, Time):
        return Time(value.microseconds + shift_us, value.usec_per_sec) if value.microseconds else value
    if not dataclasses.is_dataclass(value) or isinstance(value, type):
        return value
    fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    changed = {name: new for name, old in fields.items() if (new := _shifted(old, shift_us)) is not old}
    return dataclasses.replace(value, **changed) if changed else value

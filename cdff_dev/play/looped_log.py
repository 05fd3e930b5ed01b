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

#: Largest number of laps: thirty years of laps of one minute each. A player needs a stated end.
_LAPS = 1 << 24


class LoopedLog(LogSource):
    """A log whose last sample is followed by its first one, at later times.

    Poses of wheel odometry are multiplied by the motion of the previous laps, because odometry does not
    return to its start. All other samples repeat, also if the robot does not return to its start.

    ``is_repeated`` is False for a log that ends with the current lap; it may change between reads.

    Raises InputError for a log without samples.
    """

    def __init__(self, log: LogSource, *, is_repeated: bool = True) -> None:
        self._log, self.is_repeated = log, is_repeated
        infos = [info for info in log.streams.values() if not info.is_empty]
        if not infos:
            raise InputError("a log without samples cannot be repeated")
        spacings_ns = [(i.t1_ns - i.t0_ns) // (i.count - 1) for i in infos if i.count > 1]
        # The first sample of a lap follows the last one of the lap before after the shortest period.
        step_ns = max(min(spacings_ns, default=0) // 1000 * 1000, 1000)
        self._t0_ns = min(i.t0_ns for i in infos)
        self._period_ns = max(i.t1_ns for i in infos) - self._t0_ns + step_ns
        #: For each lap, the motion of all previous laps by stream of odometry: T_first_start.
        self._T_laps: list[dict[str, UncertainTransform]] = [{}]
        self._T_one: dict[str, UncertainTransform] | None = None

    @property
    def streams(self) -> dict[str, StreamInfo]:
        """Streams by name; the end of a repeated log is that of the last possible lap."""
        later_ns = _LAPS * self._period_ns if self.is_repeated else 0
        return {
            name: dataclasses.replace(info, t1_ns=info.t1_ns + later_ns)
            for name, info in self._log.streams.items()
        }

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """Topics and fields that have no stream, by their names in the log."""
        return self._log.unconverted

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples of lap after lap."""
        return self.samples_from(self._t0_ns, streams)

    def samples_from(self, stamp_ns: int, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples from a stamp on, which may be in a later lap."""
        counts = {name: info.count for name, info in self._log.streams.items()}
        first = max((stamp_ns - self._t0_ns) // self._period_ns, 0)
        for lap in range(first, _LAPS):
            T_lap = self._motion_before(lap)
            start_ns = max(stamp_ns - lap * self._period_ns, self._t0_ns)
            for sample in self._log.samples_from(start_ns, streams):
                T_previous_laps = T_lap.get(sample.stream)
                value = (
                    sample.value if T_previous_laps is None else _continue_odometry(sample, T_previous_laps)
                )
                yield self._later(sample, value, lap, counts[sample.stream])
            if not self.is_repeated:
                return

    def lap_end_ns(self, stamp_ns: int) -> int:
        """Return the last stamp of the lap that contains a stamp."""
        lap = max((stamp_ns - self._t0_ns) // self._period_ns, 0)
        return max(i.t1_ns for i in self._log.streams.values()) + lap * self._period_ns

    def close(self) -> None:
        """Close the files."""
        self._log.close()

    def _motion_before(self, lap: int) -> dict[str, UncertainTransform]:
        """Return the motion of the laps before a lap by stream of odometry; empty for the first lap."""
        while lap >= len(self._T_laps):
            before, T_lap = self._T_laps[-1], {}
            for stream, last in self._motion_of_a_lap().items():
                T_lap[stream] = before[stream] @ last if before else last
            self._T_laps.append(T_lap)
        return self._T_laps[lap]

    def _motion_of_a_lap(self) -> dict[str, UncertainTransform]:
        """Return the last pose of each stream of odometry."""
        if self._T_one is None:
            odometry = [n for n, i in self._log.streams.items() if n.endswith("/wheels.odometry") and i.count]
            last = {sample.stream: sample.value.transform for sample in self._log.samples(odometry)}
            self._T_one = last
        return self._T_one

    def _later(self, sample: LogSample, value: Any, lap: int, count: int) -> LogSample:
        """Return a sample of a lap; those of the first lap stay as they are, with the id of their header."""
        if lap == 0:
            return sample
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
            sample, stamp_ns=stamp_ns, seq=seq, value=_shift_times(value, shift_ns // 1000), header=header
        )


def _continue_odometry(sample: LogSample, T_previous_laps: UncertainTransform) -> TransformWithCovariance:
    """Return a pose of odometry after the motion ``T_previous_laps`` of the previous laps."""
    pose: TransformWithCovariance = sample.value
    moved_pose = TransformWithCovariance.from_transform(
        T_previous_laps @ pose.transform, parent="", child="", stamp_ns=sample.stamp_ns
    )
    return dataclasses.replace(pose, data=moved_pose.data)


def _shift_times(value: Any, shift_us: int) -> Any:
    """Return a message with all its times later; an unset time stays."""
    if isinstance(value, Time):
        return Time(value.microseconds + shift_us, value.usec_per_sec) if value.microseconds else value
    if not dataclasses.is_dataclass(value) or isinstance(value, type):
        return value
    fields = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    changed = {name: new for name, old in fields.items() if (new := _shift_times(old, shift_us)) is not old}
    return dataclasses.replace(value, **changed) if changed else value

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A part of a log: some of its streams, within a time interval."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from fnmatch import fnmatchcase

from cdff_common.clock import parse_stamp
from cdff_common.errors import InputError
from cdff_common.world.history import is_static
from cdff_dev.logs import LogSample, LogSource, StreamInfo
from cdff_dev.logs.source import Unconverted


class LogPart(LogSource):
    """The streams of a log that match a pattern, from ``start`` for ``duration_s``.

    Parameters
    ----------
    patterns : collection of str
        Patterns of stream names such as ``*/navcam.*``; empty for all streams.
    start : str
        Seconds after the first sample of the streams, negative ones before the last, or a time (RFC 3339).
    duration_s : float, optional
        Default: to the end.

    Attributes
    ----------
    left_out : list of str
        Streams of static poses without a sample in the interval. Their stamps do not define it: they can be
        those of the start of a program, decades later than the time of a simulation.

    Raises
    ------
    InputError
        If no stream matches, ``start`` or ``duration_s`` has another form, or no sample is in the interval.
    """

    def __init__(
        self,
        log: LogSource,
        patterns: Collection[str] = (),
        start: str = "0",
        duration_s: float | None = None,
    ) -> None:
        self._log = log
        infos = {n: i for n, i in log.streams.items() if not patterns or _matches(n, patterns)}
        if not infos:
            raise InputError(
                f"no stream matches {', '.join(patterns)}; the log has {', '.join(log.streams) or 'none'}"
            )
        if duration_s is not None and not 0.0 <= duration_s < math.inf:
            raise InputError(f"--duration {duration_s}: expected seconds, 0 or more")
        timed = [i for n, i in infos.items() if not i.is_empty and not is_static(n)]
        timed = timed or [i for i in infos.values() if not i.is_empty]
        first_ns = min((i.t0_ns for i in timed), default=0)
        last_ns = max((i.t1_ns for i in timed), default=0)
        self._t0_ns = _start_ns(start, first_ns, last_ns)
        self._t1_ns = last_ns if duration_s is None else min(last_ns, self._t0_ns + int(duration_s * 1e9))
        if not first_ns <= self._t0_ns <= self._t1_ns:
            raise InputError(
                f"--start {start}, --duration {duration_s}: the log has {(last_ns - first_ns) / 1e9:g} s"
            )
        self._infos = {name: self._restrict_streams(name, info) for name, info in infos.items()}
        self.left_out = [
            n for n, i in infos.items() if is_static(n) and self._infos[n].is_empty != i.is_empty
        ]

    @property
    def streams(self) -> dict[str, StreamInfo]:
        """Streams by name, with the numbers and times of the samples of the part."""
        return self._infos

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """Content without a stream."""
        return self._log.unconverted

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples of the part in the order of the log."""
        return self.samples_from(self._t0_ns, streams)

    def samples_from(self, stamp_ns: int, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples of the part from a stamp on, in the order of the log."""
        names = list(self._infos) if streams is None else [n for n in streams if n in self._infos]
        for sample in self._log.samples_from(max(stamp_ns, self._t0_ns), names):
            if sample.stamp_ns > self._t1_ns:
                return
            yield sample

    def close(self) -> None:
        """Close the files."""
        self._log.close()

    def _restrict_streams(self, name: str, info: StreamInfo) -> StreamInfo:
        if self._t0_ns <= info.t0_ns and info.t1_ns <= self._t1_ns:
            return info
        stamps_ns = self._log.stamps_ns(name)
        stamps_ns = stamps_ns[(stamps_ns >= self._t0_ns) & (stamps_ns <= self._t1_ns)]
        times = (int(stamps_ns.min()), int(stamps_ns.max())) if len(stamps_ns) else (0, 0)
        return StreamInfo(info.type_name, len(stamps_ns), *times)


def _start_ns(start: str, first_ns: int, last_ns: int) -> int:
    """Return the stamp of a start; raises InputError."""
    if "T" in start:
        return parse_stamp(start, "--start")
    try:
        seconds = float(start)
    except ValueError:
        seconds = math.nan
    if not math.isfinite(seconds):
        raise InputError(f"--start {start!r}: expected seconds, or a time such as 2026-01-01T00:00:00Z")
    return (last_ns if seconds < 0 else first_ns) + int(seconds * 1e9)


def _matches(name: str, patterns: Collection[str]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)

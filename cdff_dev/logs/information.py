# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Content of a log, as text and as JSON."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cdff_common.clock import format_stamp
from cdff_dev.logs.formats import LogLocation
from cdff_dev.logs.source import LogSource, StreamInfo
from cdff_dev.logs.timing import Timing, timing


@dataclass(frozen=True, slots=True)
class StreamReport:
    """Content of a stream; ``frame`` and ``child`` are those of its first sample, empty without a header."""

    info: StreamInfo
    timing: Timing
    frame: str
    child: str

    def to_json(self) -> dict[str, Any]:
        """Return the report for JSON; stamps are texts, since they exceed the precision of some readers."""
        times = asdict(self.timing) | {"longest_gap_at_ns": str(self.timing.longest_gap_at_ns)}
        return {
            "type": self.info.type_name,
            "count": self.info.count,
            "t0_ns": str(self.info.t0_ns),
            "t1_ns": str(self.info.t1_ns),
            "frame": self.frame,
            "child": self.child,
            **times,
        }

    def text(self, name: str) -> list[str]:
        """Return one line, and one for each irregularity."""
        times = self.timing
        rate = _rate(times.mean_rate_hz if times.has_bursts else times.rate_hz)
        start = format_stamp(self.info.t0_ns) if self.info.count else "empty"
        frames = f"  {self.frame} → {self.child}" if self.child else f"  {self.frame}"
        interval = f"{start} + {times.duration_s:.3f} s"
        head = f"{name}  {self.info.type_name:24} {self.info.count:8d} {rate}  {interval}"
        lines = [head + (frames if self.frame else "")]
        if times.has_bursts:
            lines.append(f"    in bursts with {times.rate_hz:.0f} Hz; the rate is the mean")
        if times.gaps:
            at = format_stamp(times.longest_gap_at_ns)
            lines.append(f"    {times.gaps} gaps, the longest of {times.longest_gap_s:.3f} s after {at}")
        if times.repeated or times.backwards or times.clock_jumps:
            lines.append(
                f"    {times.repeated} repeated stamps, {times.backwards} backwards, "
                f"{times.clock_jumps} jumps of the clock"
            )
        return lines


def _rate(rate_hz: float) -> str:
    """Return a rate with 11 characters: in hertz, or as the period if that is above 10 s."""
    if not rate_hz:
        return " " * 11
    return f"{rate_hz:8.2f} Hz" if rate_hz >= 0.1 else f"1/{1.0 / rate_hz:.0f} s".rjust(11)


def stream_reports(log: LogSource) -> dict[str, StreamReport]:
    """Return the report of each stream; the first sample of each stream is read."""
    reports = {}
    firsts = log.first_samples()
    for name, info in log.streams.items():
        header = firsts[name].header if name in firsts else None
        frame, child = ("", "") if header is None else (header.frame, header.child or "")
        reports[name] = StreamReport(info, timing(log.stamps_ns(name)), frame, child)
    return reports


def size_bytes(path: str) -> int:
    """Return the size of the files of a log."""
    location = LogLocation.of(path)
    files = location.folder.rglob("*") if location.folder else location.files
    return sum(file.stat().st_size for file in map(Path, files) if file.is_file())

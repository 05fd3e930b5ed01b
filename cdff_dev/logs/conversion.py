# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of a log of any format to a log of another format."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from cdff_common.errors import InputError
from cdff_common.interfaces.product import Header
from cdff_common.progress import counted
from cdff_dev.logs.mapping import LogMap, stream_map, topic_map
from cdff_dev.logs.restored import with_texts
from cdff_dev.logs.sinks import ROS2, Loss, Substitute, create_log, refuse_own_input
from cdff_dev.logs.source import LogSource, StreamInfo, Unconverted, chosen_streams


@dataclass(frozen=True, slots=True)
class ConversionReport:
    """Result of a conversion.

    Attributes
    ----------
    written : mapping
        Number of samples by stream.
    losses : mapping
        Number of samples by stream and field that the new log does not hold.
    substitutes : mapping
        Number of samples by stream, type of its messages, and the reason why it is not a usual one.
    unconverted : mapping
        Content of the source without a stream.
    """

    written: Mapping[str, int]
    losses: Mapping[Loss, int]
    substitutes: Mapping[Substitute, int]
    unconverted: Mapping[str, Unconverted]

    def to_json(self) -> dict[str, Any]:
        """Return the report as JSON."""
        return {
            "written": dict(self.written),
            "losses": [
                {"stream": stream, "loss": loss, "count": count}
                for (stream, loss), count in self.losses.items()
            ],
            "substitutes": [
                {"stream": stream, "message": message, "reason": reason, "count": count}
                for (stream, message, reason), count in self.substitutes.items()
            ],
            "unconverted": {
                name: {"type": item.type_name, "count": item.count, "reason": item.reason}
                for name, item in self.unconverted.items()
            },
        }

    def lines(self) -> list[str]:
        """Return one line for everything that the new log does not hold, or not in a usual message."""
        return [
            *(
                f"not held: {stream}: {loss} ({count} samples)"
                for (stream, loss), count in self.losses.items()
            ),
            *(
                f"as {message}: {stream} ({count} samples): {reason}"
                for (stream, message, reason), count in self.substitutes.items()
            ),
            *(
                f"not converted: {name}: {item.count} x {item.type_name}: {item.reason}"
                for name, item in self.unconverted.items()
            ),
        ]


@dataclass(frozen=True, slots=True)
class TimeSpan:
    """Part of a log: ``duration_s`` from ``start_s`` after its first sample; all of it by default."""

    start_s: float = 0.0
    duration_s: float | None = None

    def interval_ns(self, streams: Iterable[StreamInfo]) -> tuple[int, int | None]:
        """Return the first stamp of streams, and the first one after the part, or None for the end.

        Raises InputError if start or duration is negative or not finite.
        """
        for name, seconds in (("--start", self.start_s), ("--duration", self.duration_s or 0.0)):
            if not 0.0 <= seconds < float("inf"):
                raise InputError(f"{name} {seconds}: expected seconds, 0 or more")
        starts = [info.t0_ns for info in streams if info.count]
        start_ns = min(starts, default=0) + round(self.start_s * 1e9)
        return start_ns, None if self.duration_s is None else start_ns + round(self.duration_s * 1e9)


def convert_log(
    log: LogSource,
    path: Path,
    *,
    mapping: LogMap | None = None,
    streams: Collection[str] | None = None,
    span: TimeSpan | None = None,
    schemas: str = ROS2,
) -> ConversionReport:
    """Write the samples of a log to a new log; the memory does not grow with the log.

    Parameters
    ----------
    log : LogSource
    path : Path
        New log, see ``create_log``.
    mapping : LogMap, optional
        Names in the new log that are not the default ones.
    streams : collection of str, optional
        Default: all.
    span : TimeSpan, optional
    schemas : str
        Schemas of an MCAP file, see ``create_log``.

    Raises
    ------
    InputError, StorageError
        As ``create_log`` and ``topic_map``.
    CodecError
        If a sample cannot be read.
    """
    refuse_own_input(log, path)
    chosen = chosen_streams(log.streams, streams)
    infos = {name: log.streams[name] for name in chosen}
    is_infuse = path.suffix.lower() == ".msg"
    names = (stream_map if is_infuse else topic_map)(infos, mapping)
    start_ns, end_ns = (span or TimeSpan()).interval_ns(infos.values())
    written: Counter[str] = Counter()
    total = sum(info.count for info in infos.values())
    with (
        create_log(path, names, is_whole=True, schemas=schemas) as sink,
        closing(counted(log.samples_from(start_ns, chosen), total, "samples")) as samples,
    ):
        for sample in samples:
            if end_ns is not None and sample.stamp_ns >= end_ns:
                break
            stream, value, header = sample.stream, sample.value, sample.header
            if is_infuse:
                stream, value = names.streams[stream].to, with_texts(value, names.frames)
                header = _rename(header, names.frames)
            sink.write(stream, value, sample.stamp_ns, header)
            written[sample.stream] += 1
    return ConversionReport(written, sink.losses, sink.substitutes, log.unconverted)


def _rename(header: Header | None, frames: Mapping[str, str]) -> Header | None:
    if header is None or not frames:
        return header
    child = None if header.child is None else frames.get(header.child, header.child)
    return replace(header, frame=frames.get(header.frame, header.frame), child=child)

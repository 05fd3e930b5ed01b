# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Interface of logs of any format: streams, and samples in a defined order."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from cdff_common.contract.foreign_names import is_anchor, is_mount
from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Header, Quality, product_id


@dataclass(frozen=True, slots=True)
class StreamInfo:
    """Type, number of samples and time interval of a stream.

    Attributes
    ----------
    type_name : str
        ASN.1 type of the samples.
    count : int
        Number of samples; 0 also for a stream that grows while it is played.
    t0_ns, t1_ns : int
        Smallest and largest stamp; both 0 without samples.
    """

    type_name: str
    count: int
    t0_ns: int
    t1_ns: int

    @property
    def is_empty(self) -> bool:
        """True if the stream has no samples and does not grow."""
        return self.count == 0 and self.t0_ns == self.t1_ns


@dataclass(frozen=True, slots=True)
class Unconverted:
    """A topic or field of a log that has no stream.

    Attributes
    ----------
    type_name : str
        Message type in the log.
    count : int
        Number of messages.
    reason : str
    """

    type_name: str
    count: int
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class LogSample:
    """One sample of a log.

    Attributes
    ----------
    stream : str
        ``/{robot}/{sensor}.{stream}`` or ``/{robot}/{dfpc}.{port}``.
    type_name : str
    stamp_ns : int
        Stamp in the log, a multiple of 1000.
    seq : int
        Number of the sample in its stream, from 0, in the order of writing.
    value : Any
        A message of ``cdff_common.types``.
    header : Header or None
        Header, if one was recorded.
    """

    stream: str
    type_name: str
    stamp_ns: int
    seq: int
    value: Any
    header: Header | None = None

    def to_sample(self, port: str, robot: str) -> Sample:
        """Return the sample for a port of a DFPC; without a header it gets an id that names ``robot``."""
        header = self.header
        sensor, _, stream = self.stream.rsplit("/", 1)[-1].partition(".")
        return Sample(
            port=port,
            stamp_ns=self.stamp_ns,
            seq=self.seq,
            value=self.value,
            id=header.id if header else product_id(robot, sensor, stream, self.stamp_ns, self.seq, ""),
            frame=header.frame if header else "",
            child=(header.child or "") if header else "",
            quality=header.quality if header else Quality(),
        )


def split_stream(stream: str) -> tuple[str, str, str]:
    """Return robot, sensor and stream of a name such as ``/mana/navcam.pair``.

    Raises InputError on other forms.
    """
    robot, _, sensor_and_port = stream.removeprefix("/").partition("/")
    sensor, _, port = sensor_and_port.partition(".")
    if not (stream.startswith("/") and robot and sensor and port) or "/" in sensor_and_port:
        raise InputError(f"stream {stream!r}: expected /robot/sensor.stream")
    return robot, sensor, port


def chosen_streams(known: Collection[str], streams: Collection[str] | None) -> list[str]:
    """Return ``streams``, or all known streams, in order; raises InputError if one is unknown."""
    names = sorted(known if streams is None else set(streams))
    if unknown := [name for name in names if name not in known]:
        raise InputError(f"stream {unknown[0]!r}: expected one of {', '.join(known)}")
    return names


def recorded_header(
    stream: str, seq: int, stamp_ns: int, *, frame: str = "", child: str | None = None, producer: str = ""
) -> Header:
    """Return a header for a sample that was recorded without one.

    By default its frame is that of the sensor.
    """
    robot, sensor, port = split_stream(stream)
    return Header(
        id=product_id(robot, sensor, port, stamp_ns, seq, ""),
        seq=seq,
        t0_ns=stamp_ns,
        t1_ns=stamp_ns,
        frame=frame or f"{robot}/{sensor}",
        child=child,
        producer=producer or sensor,
    )


def only_stream(log: LogSource, type_names: Collection[str], stream: str | None, content: str) -> str:
    """Return the only stream with one of the types, or ``stream`` if given.

    Streams that state the location of a local frame or the pose of a sensor are only used if given.

    Raises InputError if there is no such stream, or several; ``content`` names the data in the message.
    """
    known = [name for name, info in log.streams.items() if info.type_name in type_names]
    if stream in known:
        return stream
    known = [name for name in known if not (is_anchor(name) or is_mount(name))]
    if stream is None and len(known) == 1:
        return known[0]
    fault = f"{len(known)} streams of {content}" if stream is None else f"no {content} in stream {stream!r}"
    raise InputError(f"{fault}; name one of: {', '.join(known) or 'none exists'}")


class LogSource(Protocol):
    """A log of any format."""

    @property
    def streams(self) -> dict[str, StreamInfo]:
        """Streams by name."""

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """Topics and fields that have no stream, by their names in the log."""
        return {}

    @property
    def others(self) -> LogSource | None:
        """Content without a stream that is decoded: its samples are dictionaries, lists, arrays and numbers.

        The names are those in ``unconverted``, the types those of the log.
        """
        return None

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples of all or some streams in the order (stamp_ns, stream, seq)."""

    def samples_from(self, stamp_ns: int, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples from a stamp on, in the order of ``samples``; by default others are read too."""
        return (sample for sample in self.samples(streams) if sample.stamp_ns >= stamp_ns)

    def first_samples(self, streams: Collection[str] | None = None) -> dict[str, LogSample]:
        """Return the first sample of all or some streams that have one; by default each is read for it."""
        names = chosen_streams(self.streams, streams)
        sample_by_stream = {name: next(iter(self.samples([name])), None) for name in names}
        return {name: sample for name, sample in sample_by_stream.items() if sample is not None}

    def stamps_ns(self, stream: str) -> NDArray[np.int64]:
        """Return the stamps of a stream in the order of writing; by default all its samples are read."""
        stamps = sorted((sample.seq, sample.stamp_ns) for sample in self.samples([stream]))
        return np.array([stamp_ns for _, stamp_ns in stamps], np.int64)

    def close(self) -> None:
        """Close the files."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bags of ROS as logs: each topic whose message type has a conversion becomes a stream."""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.interfaces import Connection

from cdff_common.errors import CodecError, InputError
from cdff_dev.logs.formats.ros.conversions import CAMERA_INFO, CONVERSIONS, NO_CONVERSION, Conversion
from cdff_dev.logs.formats.ros.topics import Topic, namespace
from cdff_dev.logs.names import robot_name
from cdff_dev.logs.source import (
    LogSample,
    LogSource,
    StreamInfo,
    Unconverted,
    chosen_streams,
    recorded_header,
)

#: Bytes of the stamp of a message that begins with a header: seconds and nanoseconds, in ROS 1 after the
#: sequence number, in ROS 2 after the encapsulation of CDR.
_STAMP = slice(4, 12)


class RosLog(LogSource):
    """Bag files of one recording as a ``LogSource``.

    Samples have the stamp of their header; those of messages without a header have the time of recording.
    Opening a bag reads it once, for the stamps; a message is decoded when its sample is yielded.

    Parameters
    ----------
    files : list of Path
        One or several ROS 1 bags, or one ROS 2 bag: its folder, or a single file.

    Raises
    ------
    CodecError
        If a file is not a bag, or its message definitions are missing.
    """

    def __init__(self, files: list[Path]) -> None:
        self._files = files
        self._reader = AnyReader(files)
        self._open()
        try:
            self._topics = self._converted_topics(robot_name(files[0]))
            self._unconverted = self._other_topics()
            self._index()
        except BaseException:
            self.close()
            raise

    @property
    def streams(self) -> dict[str, StreamInfo]:
        """Streams by name, in order."""
        return self._streams

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """Topics without a stream."""
        return self._unconverted

    def close(self) -> None:
        """Close the files."""
        self._reader.close()

    def _open(self) -> None:
        try:
            self._reader.open()
        except (AnyReaderError, ValueError, OSError) as error:
            raise CodecError(f"{self._files[0]}: not a readable bag: {error}") from error

    def _converted_topics(self, robot: str) -> dict[int, Topic]:
        """Return the topics whose message type has a conversion, by the identity of their connection."""
        cameras = self._cameras()
        topics = {}
        for connection in self._reader.connections:
            if conversion := CONVERSIONS.get(connection.msgtype):
                camera = cameras.get(namespace(connection.topic))
                topics[id(connection)] = Topic(connection.topic, robot, conversion, camera)
        return topics

    def _cameras(self) -> dict[str, Any]:
        """Return the first calibration of each camera by the namespace of its topic."""
        cameras: dict[str, Any] = {}
        for connection in self._reader.connections:
            if connection.msgtype == CAMERA_INFO:
                for _, _, raw in self._messages([connection]):
                    cameras[namespace(connection.topic)] = self._reader.deserialize(raw, CAMERA_INFO)
                    break
        return cameras

    def _other_topics(self) -> dict[str, Unconverted]:
        """Return the topics without a conversion, with the reason."""
        found: dict[str, Unconverted] = {}
        for connection in self._reader.connections:
            if id(connection) not in self._topics and connection.msgtype != CAMERA_INFO:
                known = found.get(connection.topic)
                count = connection.msgcount + (known.count if known else 0)
                reason = NO_CONVERSION.get(connection.msgtype, "no CDFF type has its content")
                found[connection.topic] = Unconverted(connection.msgtype, count, reason)
        return found

    def _index(self) -> None:
        """Read the stamps of all messages that are converted, in the order of recording."""
        names, stamps = [], []
        types: dict[str, str] = {}
        for name, stamp_ns, topic, _ in self._parts(set()):
            names.append(name)
            stamps.append(stamp_ns)
            types[name] = topic.conversion.type_name
        self._stamps_ns = np.array(stamps, dtype=np.int64)
        self._names = np.array(names, dtype=object)
        self._streams: dict[str, StreamInfo] = {}
        for name, type_name in sorted(types.items()):
            times = self._stamps_ns[self._names == name]
            self._streams[name] = StreamInfo(type_name, len(times), int(times.min()), int(times.max()))

    def _parts(self, streams: Collection[str]) -> Iterator[tuple[str, int, Topic, Any]]:
        """Yield stream, stamp, topic and content of each sample in the order of recording.

        Without ``streams`` all are yielded. The content is a message, or its bytes if it has one sample.
        """
        connections = [c for c in self._reader.connections if id(c) in self._topics]
        for connection, recorded_ns, raw in self._messages(connections):
            topic = self._topics[id(connection)]
            if topic.conversion.split is None:
                stamp_ns = _stamp_ns(topic.conversion, recorded_ns, raw)
                parts = [(topic.stream, stamp_ns, (connection, raw))]
            else:
                messages = topic.conversion.split(self._decoded(connection, raw))
                parts = [(topic.stream_of(m), _header_ns(m.header) or recorded_ns, m) for m in messages]
            for name, stamp_ns, content in parts:
                if not streams or name in streams:
                    yield name, round(stamp_ns / 1000) * 1000, topic, content

    def _messages(self, connections: list[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        if not connections:
            return
        try:
            yield from self._reader.messages(connections)
        except (AnyReaderError, ValueError, OSError, EOFError) as error:
            raise CodecError(f"{self._files[0]}: the bag ends in a damaged message: {error}") from error

    def _decoded(self, connection: Connection, raw: bytes) -> Any:
        try:
            return self._reader.deserialize(raw, connection.msgtype)
        except (AnyReaderError, ValueError) as error:
            raise CodecError(f"{self._files[0]}: {connection.topic}: {error}") from error

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples of all or some streams in the order (stamp_ns, stream, seq).

        A message is held back until no message with an earlier stamp can follow in the bag.

        Raises
        ------
        InputError
            If a stream is not in the log.
        CodecError
            If a message cannot be decoded or converted.
        """
        chosen = set(chosen_streams(self.streams, streams))
        stamps_ns = self._stamps_ns[np.isin(self._names, list(chosen))]
        earliest_later = np.minimum.accumulate(stamps_ns[::-1])[::-1]
        waiting: list[tuple[int, str, int, Topic, Any]] = []
        seqs: Counter[str] = Counter()
        for i, (name, stamp_ns, topic, content) in enumerate(self._parts(chosen) if chosen else ()):
            while waiting and waiting[0][0] < earliest_later[i]:
                yield self._sample(*heapq.heappop(waiting))
            heapq.heappush(waiting, (stamp_ns, name, seqs[name], topic, content))
            seqs[name] += 1
        while waiting:
            yield self._sample(*heapq.heappop(waiting))

    def _sample(self, stamp_ns: int, name: str, seq: int, topic: Topic, content: Any) -> LogSample:
        message = self._decoded(*content) if isinstance(content, tuple) else content
        try:
            value, frame, child = topic.conversion.convert(message, topic, stamp_ns)
        except (InputError, ValueError) as error:
            raise CodecError(f"{self._files[0]}: {topic.name} message {seq}: {error}") from error
        header = recorded_header(name, seq, stamp_ns, frame=frame, child=child)
        return LogSample(name, topic.conversion.type_name, stamp_ns, seq, value, header)


def _stamp_ns(conversion: Conversion, recorded_ns: int, raw: bytes) -> int:
    """Return the stamp of the header; without one, or if it is zero, the time of recording."""
    if not conversion.has_header:
        return recorded_ns
    seconds, nanoseconds = np.frombuffer(raw[_STAMP], "<u4")
    return int(seconds) * 1_000_000_000 + int(nanoseconds) or recorded_ns


def _header_ns(header: Any) -> int:
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)

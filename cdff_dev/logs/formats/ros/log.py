# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings of ROS messages as logs: each topic whose message type has a conversion becomes a stream."""

from __future__ import annotations

import heapq
import logging
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import CodecError, InputError
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.logs.formats.ros.named_calibration import NamedCalibration
from cdff_dev.logs.formats.ros.pairs import PairAssembly
from cdff_dev.logs.formats.ros.recording import (
    PARSER_ERRORS,
    Channel,
    Encoded,
    Recording,
    encoded_stamp_ns,
)
from cdff_dev.logs.formats.ros.stereo import FrameTree, StereoTopics, stereo_candidates, stereo_topics
from cdff_dev.logs.source import (
    LogSample,
    LogSource,
    StreamInfo,
    Unconverted,
    chosen_streams,
    recorded_header,
)
from services.ros_messages.clouds import unused_fields
from services.ros_messages.conversions import (
    CAMERA_INFO,
    CLOUD,
    CONVERSIONS,
    DEPTH,
    FRAME_TREES,
    IMAGES,
    LOCAL_FRAME_POSE,
    NOT_LOGGED,
    OMITTED_FIELDS,
    transform_matrix,
)
from services.ros_messages.depth import is_depth
from services.ros_messages.fixes import FIX, LocalFrame, has_covariance, no_position
from services.ros_messages.images import camera_model
from services.ros_messages.topics import Topic, namespace

_log = logging.getLogger(__name__)
_MAX_STAMP_NS = np.iinfo(np.int64).max - 1000


class _Part(NamedTuple):
    """A sample that is not decoded: its encoded message, or both of a pair, or a part of a message."""

    stream: str
    stamp_ns: int
    source: Topic | StereoTopics
    content: Any


class _EncodedMessage(NamedTuple):
    channel: Channel
    raw: Encoded


class RosLog(LogSource):
    """A recording as a ``LogSource``.

    Samples have the stamp of their header; those of messages without a header have the time of recording.
    Opening a log reads the recording once, for the stamps; a message is decoded when its sample is yielded.

    Images of a left and a right camera (names as in ``stereo_pairs``) with calibrations are the stream
    ``/robot/{namespace}.pair`` of rectified grey pairs with the stamp of the left image. It replaces the
    streams of both images if these are grey and rectified, and thus equal to those of the pairs.

    Parameters
    ----------
    recording : Recording
    robot : str
        Robot id of the streams.
    local_frames : mapping, optional
        Local frames of positions of satellite navigation by their stream without the robot. By default the
        origin is the first position of the recording. A recording with local frames was written by CDFF: its
        messages have no field without a place in CDFF.
    calibration : NamedCalibration, optional
        Cameras of all images instead of those of the recording.

    Raises
    ------
    CodecError
        If a message cannot be decoded.
    """

    def __init__(
        self,
        recording: Recording,
        robot: str,
        local_frames: Mapping[str, LocalFrame] | None = None,
        calibration: NamedCalibration | None = None,
    ) -> None:
        self._recording, self._calibration = recording, calibration
        self._local_frames = local_frames or {}
        self._split_streams: dict[str, set[str]] = {}
        try:
            self._topics = self._converted_topics(robot)
            self._unconverted = self._other_topics()
            if local_frames is None:
                self._unconverted |= self._other_fields()
                self._convert_depths()
            self._pairs = PairAssembly(self._stereo_cameras())
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
        """Topics without a stream, and damaged parts."""
        return self._unconverted | dict(self._recording.unconverted)

    def stamps_ns(self, stream: str) -> NDArray[np.int64]:
        """Return the stamps of a stream in the order of recording."""
        stamps_ns: NDArray[np.int64] = self._stamps_ns[self._names == stream]
        return stamps_ns

    def close(self) -> None:
        """Close the files."""
        self._recording.close()

    def _converted_topics(self, robot: str) -> dict[int, Topic]:
        """Return the topics whose message type has a conversion, by the identity of their channel."""
        cameras, local_frame = self._cameras(), self._first_position()
        images = {c.topic for c in self._recording.channels if c.type_name in IMAGES and not c.fault}
        if self._calibration is not None and not images:
            raise InputError(f"{self._recording.name}: no images for the calibration")
        topics = {}
        for channel in self._recording.channels:
            is_left_out = bool(channel.fault) or channel.type_name in NOT_LOGGED
            conversion = None if is_left_out else CONVERSIONS.get(channel.type_name)
            if conversion:
                camera = cameras.get(namespace(channel.topic))
                if self._calibration is not None and channel.topic in images:
                    camera = self._calibration.info(channel.topic, images)
                topic = Topic(channel.topic, robot, conversion, camera)
                if channel.type_name == FIX:
                    stated = self._local_frames.get(topic.stream.removeprefix(f"/{robot}/"))
                    topic = replace(topic, local_frame=stated or local_frame)
                topics[id(channel)] = topic
        return topics

    def _convert_depths(self) -> None:
        """Choose the conversion to distances for depth images (REP 118) with a camera without distortion."""
        channels = [c for c in self._recording.channels if c.type_name in IMAGES and id(c) in self._topics]
        channels = [c for c in channels if "depth" in c.topic.lower()]
        first = self._first_messages(channels) if channels else {}
        for channel in channels:
            topic = self._topics[id(channel)]
            if channel.topic not in first or not is_depth(first[channel.topic]):
                continue
            try:
                is_ideal = camera_model(topic).is_ideal
                reason = "" if is_ideal else "its camera has lens distortion"
            except InputError as error:
                reason = str(error)
            if reason:
                name = f"distances of {channel.topic}"
                self._unconverted[name] = Unconverted("image", channel.count, f"they are images: {reason}")
            else:
                self._topics[id(channel)] = replace(topic, conversion=DEPTH)

    def _first_position(self) -> LocalFrame | None:
        """Return the local frame at the first position of the recording; None without a position."""
        channels = [c for c in self._recording.channels if c.type_name == FIX and not c.fault]
        for channel, _, raw in self._recording.messages(channels) if channels else ():
            try:
                message = self._recording.decode(channel, raw)
            except CodecError:
                continue
            if not no_position(message):
                return LocalFrame.at(message)
        return None

    def _cameras(self) -> dict[str, Any]:
        """Return the first calibration of each camera by the namespace of its topic."""
        infos = [c for c in self._recording.channels if c.type_name == CAMERA_INFO and not c.fault]
        first = self._first_messages(infos)
        return {namespace(topic): info for topic, info in first.items()}

    def _first_messages(self, channels: list[Channel]) -> dict[str, Any]:
        """Return the first message of each topic."""
        message_by_topic: dict[str, Any] = {}
        topics = {channel.topic for channel in channels if channel.count}
        for channel, _, raw in self._recording.messages(channels):
            if channel.topic not in message_by_topic:
                message_by_topic[channel.topic] = self._recording.decode(channel, raw)
            if len(message_by_topic) == len(topics):
                break
        return message_by_topic

    def _other_topics(self) -> dict[str, Unconverted]:
        """Return the topics without a conversion, with the reason."""
        unconverted_topics: dict[str, Unconverted] = {}
        for channel in self._recording.channels:
            if id(channel) not in self._topics and (channel.type_name != CAMERA_INFO or channel.fault):
                known = unconverted_topics.get(channel.topic)
                count = channel.count + (known.count if known else 0)
                reason = channel.fault or NOT_LOGGED.get(channel.type_name, "no CDFF type has its content")
                type_name = channel.original_type or channel.type_name
                unconverted_topics[channel.topic] = Unconverted(type_name, count, reason)
        return unconverted_topics

    def _other_fields(self) -> dict[str, Unconverted]:
        """Return the fields of converted messages that no CDFF field has, by topic."""
        converted = [c for c in self._recording.channels if id(c) in self._topics and c.count]
        clouds = self._first_messages([c for c in converted if c.type_name == CLOUD])
        unconverted_fields: dict[str, Unconverted] = {}
        for channel in converted:
            fields = () if channel.original_type else OMITTED_FIELDS.get(channel.type_name, ())
            if channel.topic in clouds:
                fields = unused_fields(clouds[channel.topic])
            if fields:
                name = f"{channel.topic}: {', '.join(fields)}"
                count = channel.count + (unconverted_fields[name].count if name in unconverted_fields else 0)
                type_name = channel.original_type or channel.type_name
                unconverted_fields[name] = Unconverted(type_name, count, "no CDFF field has it")
        return unconverted_fields

    def _stereo_cameras(self) -> list[StereoTopics]:
        """Return the stereo cameras; those without a usable calibration are listed as not converted."""
        cameras: list[StereoTopics] = []
        candidates = stereo_candidates({topic.name: topic for topic in self._topics.values()})
        for left, right in candidates:
            channels = [c for c in self._recording.channels if c.topic in (left.name, right.name)]
            first = self._first_messages(channels)
            if len(first) < 2:
                continue
            try:
                messages = first[left.name], first[right.name]
                stereo = None if self._calibration is None else self._calibration.stereo
                camera = stereo_topics(left, right, messages, self._tree, stereo)
            except (*PARSER_ERRORS, InputError) as error:
                name = f"pairs of {left.name}"
                self._unconverted[name] = Unconverted("stereo camera", 1, str(error))
                continue
            if any(camera.stream == other.stream for other in cameras):
                camera = camera.with_stream(left.stream.removesuffix(".frame") + ".pair")
            cameras.append(camera)
        return cameras

    def _tree(self) -> FrameTree:
        """Return the first pose of each frame of the frame trees."""
        tree: dict[str, tuple[str, FloatArray]] = {}
        channels = [c for c in self._recording.channels if c.type_name in FRAME_TREES and not c.fault]
        for channel, _, raw in self._recording.messages(channels):
            for transform in self._recording.decode(channel, raw).transforms:
                child = transform.child_frame_id.lstrip("/")
                if child not in tree:
                    tree[child] = (transform.header.frame_id.lstrip("/"), transform_matrix(transform))
        return tree

    def _index(self) -> None:
        """Read the stamps of all messages that are converted, in the order of recording."""
        parts = [
            (part.stream, part.stamp_ns, part.source) for part in self._single_parts(None, is_first=True)
        ]
        names = np.array([name for name, _, _ in parts], dtype=object)
        stamps_ns = np.array([stamp for _, stamp, _ in parts], dtype=np.int64)
        types = {name: topic.conversion.type_name for name, _, topic in parts if isinstance(topic, Topic)}
        for name, _, topic in parts:
            if isinstance(topic, Topic) and topic.conversion.split is not None:
                self._split_streams.setdefault(topic.name, set()).add(name)
        self._names, self._stamps_ns, unmatched = self._pairs.index(names, stamps_ns)
        self._unconverted |= unmatched
        types |= dict.fromkeys(self._pairs.streams, "FramePair")
        self._streams: dict[str, StreamInfo] = {}
        for name, type_name in sorted(types.items()):
            times = self._stamps_ns[self._names == name]
            if name not in self._pairs.replaced and len(times):
                self._streams[name] = StreamInfo(type_name, len(times), int(times.min()), int(times.max()))

    def _single_parts(self, streams: Collection[str] | None, *, is_first: bool = False) -> Iterator[_Part]:
        """Yield the samples of some or all streams, without pairs, in the order of recording.

        Messages without a sample are listed the first time.
        """
        channels = [c for c in self._recording.channels if self._has_streams(c, streams)]
        for channel, recorded_ns, raw in self._recording.messages(channels):
            try:
                parts = self._parts_of(channel, recorded_ns, raw, is_first=is_first)
            except (*PARSER_ERRORS, InputError) as error:
                if is_first:
                    self._leave_out(channel.topic, error)
                continue
            for part in parts:
                if streams is None or part.stream in streams:
                    yield part

    def _parts_of(self, channel: Channel, recorded_ns: int, raw: Encoded, *, is_first: bool) -> list[_Part]:
        """Return the samples of a message, which may be several of different streams."""
        topic = self._topics[id(channel)]
        if channel.type_name == FIX:
            return self._positions_of(channel, topic, recorded_ns, raw, is_first=is_first)
        if topic.conversion.split is None:
            stamp_ns = self._stamp_ns(channel, topic, recorded_ns, raw)
            return [_Part(topic.stream, stamp_ns, topic, _EncodedMessage(channel, raw))]
        return [
            _Part(
                topic.stream_of(message), _rounded(_header_ns(message.header) or recorded_ns), topic, message
            )
            for message in topic.conversion.split(self._recording.decode(channel, raw))
        ]

    def _positions_of(
        self, channel: Channel, topic: Topic, recorded_ns: int, raw: Encoded, *, is_first: bool
    ) -> list[_Part]:
        """Return the position of a message, and the pose of its local frame at the same time."""
        message = self._recording.decode(channel, raw)
        reason, type_name = no_position(message), channel.original_type or channel.type_name
        if is_first and reason:
            self._list(f"messages of {topic.name} {reason}", type_name, "they have no position")
        elif is_first and not has_covariance(message):
            name = f"messages of {topic.name} without a covariance"
            self._list(name, type_name, "their positions are converted; its elements are NaN")
        if reason:
            return []
        stamp_ns = _rounded(_header_ns(message.header) or recorded_ns)
        return [_Part(part.stream, stamp_ns, part, message) for part in (_anchor_of(topic), topic)]

    def _leave_out(self, topic: str, error: Exception) -> None:
        """List and log a message whose stamp cannot be read."""
        name = f"damaged messages of {topic}"
        if name not in self._unconverted:
            _log.warning("%s: %s: a damaged message is left out: %s", self._recording.name, topic, error)
        self._list(name, "damaged message", f"the first: {error}")

    def _list(self, name: str, type_name: str, reason: str) -> None:
        """Count a message with content that has no stream; the reason of the first such message is listed."""
        known = self._unconverted.get(name, Unconverted(type_name, 0, reason))
        self._unconverted[name] = replace(known, count=known.count + 1)

    def _has_streams(self, channel: Channel, streams: Collection[str] | None) -> bool:
        """Return whether a channel can have samples of ``streams``; None means all streams."""
        topic = self._topics.get(id(channel))
        if topic is None or streams is None:
            return topic is not None
        if topic.local_frame is not None:
            return not {topic.stream, _anchor_of(topic).stream}.isdisjoint(streams)
        if topic.conversion.split is None:
            return topic.stream in streams
        return not self._split_streams.get(topic.name, set()).isdisjoint(streams)

    def _parts(self, chosen: set[str]) -> Iterator[_Part]:
        """Yield the samples of streams in the order of recording, pairs after their second image."""
        queue = self._pairs.start()
        for part in self._single_parts(chosen | self._pairs.sources(chosen)):
            if part.stream in chosen:
                yield part
            for camera, stamp_ns, contents in queue.add(part.stream, part.stamp_ns, part.content):
                if camera.stream in chosen:
                    yield _Part(camera.stream, stamp_ns, camera, contents)

    def _stamp_ns(self, channel: Channel, topic: Topic, recorded_ns: int, raw: Encoded) -> int:
        """Return the stamp of the header; without one, or if it is zero, the time of recording."""
        if not topic.conversion.has_header:
            return _rounded(recorded_ns)
        if stamp_ns := encoded_stamp_ns(channel.encoding, raw):
            return _rounded(stamp_ns)
        if channel.encoding in ("ros1", "cdr"):
            return _rounded(recorded_ns)
        return _rounded(_header_ns(self._recording.decode(channel, raw).header) or recorded_ns)

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples of all or some streams in the order (stamp_ns, stream, seq).

        A message is held back until no message with an earlier stamp can follow in the recording.

        Raises
        ------
        InputError
            If a stream is not in the log.
        CodecError
            If a message cannot be decoded or converted.
        """
        return (self._sample(seq, part) for seq, part in self._ordered_parts(streams))

    def samples_from(self, stamp_ns: int, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples from a stamp on, in the order of ``samples``; earlier ones are not decoded."""
        for seq, part in self._ordered_parts(streams):
            if part.stamp_ns >= stamp_ns:
                yield self._sample(seq, part)

    def first_samples(self, streams: Collection[str] | None = None) -> dict[str, LogSample]:
        """Return the first sample of all or some streams, from one pass through the recording."""
        names = chosen_streams(self.streams, streams)
        first_seqs = {name: int(np.argmin(self.stamps_ns(name))) for name in names}
        sample_by_stream: dict[str, LogSample] = {}
        seqs: Counter[str] = Counter()
        for part in self._parts(set(first_seqs)) if first_seqs else ():
            if seqs[part.stream] == first_seqs[part.stream]:
                sample_by_stream[part.stream] = self._sample(seqs[part.stream], part)
                if len(sample_by_stream) == len(first_seqs):
                    break
            seqs[part.stream] += 1
        return sample_by_stream

    def _ordered_parts(self, streams: Collection[str] | None) -> Iterator[tuple[int, _Part]]:
        """Yield the number in its stream of each sample, and the sample, in the order of ``samples``."""
        chosen = set(chosen_streams(self.streams, streams))
        stamps_ns = self._stamps_ns[np.isin(self._names, list(chosen))]
        earliest_later = np.minimum.accumulate(stamps_ns[::-1])[::-1]
        waiting: list[tuple[int, str, int, _Part]] = []
        seqs: Counter[str] = Counter()
        # In a damaged bag some streams alone can be read further than all together: the index is the limit.
        for part, earliest_ns in zip(self._parts(chosen) if chosen else (), earliest_later, strict=False):
            while waiting and waiting[0][0] < earliest_ns:
                yield heapq.heappop(waiting)[2:]
            heapq.heappush(waiting, (part.stamp_ns, part.stream, seqs[part.stream], part))
            seqs[part.stream] += 1
        while waiting:
            yield heapq.heappop(waiting)[2:]

    def _sample(self, seq: int, part: _Part) -> LogSample:
        source, name, stamp_ns = part.source, part.stream, part.stamp_ns
        encoded = part.content if isinstance(source, StereoTopics) else [part.content]
        messages = [self._recording.decode(*m) if isinstance(m, _EncodedMessage) else m for m in encoded]
        try:
            if isinstance(source, StereoTopics):
                left, right = messages
                value, frame, child = source.convert(left, right, stamp_ns)
            else:
                value, frame, child = source.conversion.convert(messages[0], source, stamp_ns)
        except (*PARSER_ERRORS, InputError) as error:
            raise CodecError(f"{self._recording.name}: {name} message {seq}: {error}") from error
        header = recorded_header(name, seq, stamp_ns, frame=frame, child=child)
        return LogSample(name, source.type_name, stamp_ns, seq, value, header)


def _anchor_of(topic: Topic) -> Topic:
    """Return the topic of the pose of the local frame of positions."""
    return replace(topic, conversion=LOCAL_FRAME_POSE)


def _header_ns(header: Any) -> int:
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def _rounded(stamp_ns: int) -> int:
    """Return a stamp in whole microseconds."""
    return min(round(stamp_ns / 1000) * 1000, _MAX_STAMP_NS // 1000 * 1000)

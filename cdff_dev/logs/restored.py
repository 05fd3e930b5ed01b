# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Logs that ``cdff log convert`` has written, read with the names and types of the original log."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs.bitstream import unwrap
from cdff_common.contract.foreign_names import frame_name
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header
from cdff_common.types import (
    Frame,
    FrameExtrinsicT,
    FramePair,
    TransformWithCovariance,
    TransformWithCovarianceData,
)
from cdff_common.types.message import Message
from cdff_common.types.pointcloud_ext import mounting
from cdff_dev.logs.source import (
    LogSample,
    LogSource,
    StreamInfo,
    Unconverted,
    chosen_streams,
    recorded_header,
)
from services.ros_messages.depth import distance_image

#: Topic with the names of the original log, ``OriginalNames`` as JSON in ``std_msgs/String``.
NAMES_TOPIC = "/cdff/original_names"
#: Types of the new log whose texts are those of the original log.
_WITHOUT_FRAMES = ("Asn1Bitstream", "Joints")


@dataclass(slots=True)
class OriginalNames:
    """Names and types of a log from which another was converted.

    Attributes
    ----------
    robot : str
        Robot of the frames whose name in the new log is without it.
    streams : dict
        Stream and type in the original log, by the stream without robot under which the new log is read.
    frames : dict
        Frames of the original log by their name in the new one.
    mounts : dict
        Pose of the camera on the robot by stream of images: position, quaternion x, y, z, w, and covariance,
        as one list.
    local_frames : dict
        Local frame of a stream of positions in the new log: name there, longitude, latitude (degrees), height
        above WGS 84 (metres) and azimuth (degrees), by the stream without robot.
    """

    robot: str = ""
    streams: dict[str, tuple[str, str]] = field(default_factory=dict)
    frames: dict[str, str] = field(default_factory=dict)
    mounts: dict[str, list[float]] = field(default_factory=dict)
    local_frames: dict[str, tuple[str, float, float, float, float]] = field(default_factory=dict)

    @property
    def entry_count(self) -> int:
        """Number of streams, frames, mounts and local frames with original values."""
        return len(self.streams) + len(self.frames) + len(self.mounts) + len(self.local_frames)

    def to_json(self) -> str:
        """Return the names as JSON."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> OriginalNames | None:
        """Return the names in a text, or None if it does not have the form of ``to_json``."""
        try:
            content = json.loads(text)
            streams = {str(k): (str(v[0]), str(v[1])) for k, v in content["streams"].items()}
            frames = {str(k): str(v) for k, v in content["frames"].items()}
            mounts = {str(k): [float(x) for x in v] for k, v in content["mounts"].items()}
            local_frames = {
                str(k): (str(name), float(lon), float(lat), float(height), float(azimuth))
                for k, (name, lon, lat, height, azimuth) in content.get("local_frames", {}).items()
            }
            return cls(str(content["robot"]), streams, frames, mounts, local_frames)
        except (ValueError, TypeError, LookupError, AttributeError):
            return None


class RestoredLog(LogSource):
    """A converted log whose streams, frames and types are those of the original log.

    Topics that are copies of others for viewers, such as the frame tree, have no stream.
    """

    def __init__(self, log: LogSource, names: OriginalNames) -> None:
        self._log = log
        self._original: dict[str, tuple[str, str]] = {}
        texts: dict[str, str] = {}
        for name in log.streams:
            robot, _, name_in_robot = name.removeprefix("/").partition("/")
            if name_in_robot in names.streams:
                self._original[name] = names.streams[name_in_robot]
            texts |= {frame_name(robot, new): old for new, old in names.frames.items()}
            texts[robot] = names.robot
        self._texts = texts
        self._mounts = names.mounts
        self._read_as = {original: name for name, (original, _) in self._original.items()}

    @property
    def streams(self) -> dict[str, StreamInfo]:
        """Streams by name, in order."""
        infos = self._log.streams
        return {
            original: replace(infos[name], type_name=self._original[name][1])
            for original, name in sorted(self._read_as.items())
        }

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """Content without a stream, other than the names of the original log."""
        return {name: item for name, item in self._log.unconverted.items() if name != NAMES_TOPIC}

    def samples(self, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples of all or some streams in the order (stamp_ns, stream, seq)."""
        return self._in_order(self._log.samples(self._names_of(streams)))

    def samples_from(self, stamp_ns: int, streams: Collection[str] | None = None) -> Iterator[LogSample]:
        """Yield the samples from a stamp on, in the order of ``samples``."""
        return self._in_order(self._log.samples_from(stamp_ns, self._names_of(streams)))

    def first_samples(self, streams: Collection[str] | None = None) -> dict[str, LogSample]:
        """Return the first sample of all or some streams."""
        restored_samples = [
            self._restore(s) for s in self._log.first_samples(self._names_of(streams)).values()
        ]
        return {sample.stream: sample for sample in restored_samples}

    def _names_of(self, streams: Collection[str] | None) -> list[str]:
        """Return the names in the converted log."""
        return [self._read_as[name] for name in chosen_streams(self._read_as, streams)]

    def _in_order(self, samples: Iterator[LogSample]) -> Iterator[LogSample]:
        """Yield samples with their original content; those of the same time by their original names."""
        together: list[tuple[str, int, LogSample]] = []
        for sample in samples:
            if together and together[0][2].stamp_ns < sample.stamp_ns:
                yield from (item[2] for item in sorted(together, key=lambda item: item[:2]))
                together = []
            restored = self._restore(sample)
            together.append((restored.stream, restored.seq, restored))
        yield from (item[2] for item in sorted(together, key=lambda item: item[:2]))

    def _restore(self, sample: LogSample) -> LogSample:
        name, type_name = self._original[sample.stream]
        value = restored_value(sample.value, type_name)
        if sample.type_name not in _WITHOUT_FRAMES:
            value = with_texts(value, self._texts)
        value = with_mount(value, self._mounts.get(name))
        header = self._header(name, sample)
        return LogSample(name, type_name, sample.stamp_ns, sample.seq, value, header)

    def _header(self, name: str, sample: LogSample) -> Header | None:
        """Return a header with the original frames; None for names that CDFF lacks, as in InFuse logs."""
        if sample.header is None:
            return None
        frame, child = sample.header.frame, sample.header.child
        try:
            return recorded_header(
                name,
                sample.seq,
                sample.stamp_ns,
                frame=self._texts.get(frame, frame),
                child=None if child is None else self._texts.get(child, child),
            )
        except InputError:
            return None

    def stamps_ns(self, stream: str) -> NDArray[np.int64]:
        """Return the stamps of a stream in the order of writing."""
        return self._log.stamps_ns(self._read_as[stream])

    def close(self) -> None:
        """Close the files."""
        self._log.close()


def restored_value(value: Any, type_name: str) -> Any:
    """Return a value of a converted log as the type of the original log."""
    if type_name == type(value).ASN1_NAME:
        return value
    if type(value).ASN1_NAME == "Asn1Bitstream":
        return unwrap(value)
    if isinstance(value, Frame) and type_name == "DistanceImage":
        return distance_image(value)
    return value


def mount_row(value: Any) -> list[float] | None:
    """Return the pose of the camera of an image or pair on the robot (``OriginalNames.mounts``), or None."""
    image = value.left if isinstance(value, FramePair) else value
    if not isinstance(image, Frame) or not image.extrinsic.pose_robot_frame_sensor_frame.is_set:
        return None
    data = image.extrinsic.pose_robot_frame_sensor_frame.data
    return [*data.translation.tolist(), *data.orientation.tolist(), *data.cov.ravel().tolist()]


def with_mount(value: Any, row: Sequence[float] | None) -> Any:
    """Return an image or pair with the pose of its camera on the robot."""
    if row is None or not isinstance(value, Frame | FramePair):
        return value
    pose = TransformWithCovarianceData(np.array(row[:3]), np.array(row[3:7]), np.reshape(row[7:], (6, 6)))
    T = TransformWithCovariance(data=pose).transform
    if isinstance(value, Frame):
        return _with_mount(value, T)
    T_left_right = np.eye(4)
    T_left_right[0, 3] = value.baseline
    T_right = T @ UncertainTransform.exact(T_left_right)
    return replace(value, left=_with_mount(value.left, T), right=_with_mount(value.right, T_right))


def _with_mount(value: Frame, T_robot_sensor: UncertainTransform) -> Frame:
    robot_sensor, fixed_robot = mounting(T_robot_sensor, None, value.frame, value.metadata.time_stamp.ns)
    extrinsic = FrameExtrinsicT(
        pose_robot_frame_sensor_frame=robot_sensor, pose_fixed_frame_robot_frame=fixed_robot
    )
    return replace(value, extrinsic=extrinsic)


def with_texts(value: Any, texts: Mapping[str, str]) -> Any:
    """Return a value whose texts that are keys of ``texts``, such as names of frames, are replaced."""
    if isinstance(value, str):
        return texts.get(value, value)
    if isinstance(value, tuple):
        changed = tuple(with_texts(item, texts) for item in value)
        return changed if any(new is not old for new, old in zip(changed, value, strict=True)) else value
    if not isinstance(value, Message):
        return value
    changes = {}
    for item in fields(value):  # type: ignore[arg-type]
        old = getattr(value, item.name)
        if (new := with_texts(old, texts)) is not old:
            changes[item.name] = new
    return replace(value, **changes) if changes else value  # type: ignore[type-var]

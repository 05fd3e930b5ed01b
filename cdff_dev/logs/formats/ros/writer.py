# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Writer of logs as ROS messages: ROS 1 bags, ROS 2 bags and MCAP files.

The topic ``/cdff/original_names`` holds the names and types of the log: the new log is read with them. Each
of its messages has all names up to the next one, so that a file that ends early is read with them too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from cdff_common.errors import CodecError, InputError, StorageError
from cdff_common.interfaces.product import Header
from cdff_common.output import make_folder, storage_errors
from cdff_common.types import TransformWithCovariance
from cdff_dev.logs.differences import ROUNDING, differing_fields
from cdff_dev.logs.formats.ros.storage import (
    Bag1Storage,
    Bag2Storage,
    FoxgloveStorage,
    McapStorage,
    MessageStorage,
)
from cdff_dev.logs.mapping import LogMap
from cdff_dev.logs.restored import NAMES_TOPIC, OriginalNames, mount_row, with_mount
from cdff_dev.logs.sinks import FOXGLOVE, FOXGLOVE_JSON, ROS2, LogSink, Loss, Substitute
from cdff_dev.logs.source import recorded_header
from services.ros_messages.encoders import bitstream, encoder, transform_message
from services.ros_messages.encoding import Encoded, Encoder, Outgoing, Target
from services.ros_messages.fixes import EARTH, FIX, LocalFrame, is_position

_STORAGES: dict[tuple[str, str], Callable[[Path], MessageStorage]] = {
    (".bag", ROS2): Bag1Storage,
    (".mcap", ROS2): McapStorage,
    (".mcap", FOXGLOVE): partial(FoxgloveStorage, encoding="protobuf"),
    (".mcap", FOXGLOVE_JSON): partial(FoxgloveStorage, encoding="json"),
    ("", ROS2): Bag2Storage,
}
_FRAME_TREE = ("/tf", "tf2_msgs/msg/TFMessage")
#: Number of names at the start of a path that a report contains: of
#: ``left.extrinsic.pose_robot_frame_sensor_frame.data``, the first three.
_PATH_LENGTH = 3
#: Fields of a header that the reader sets itself, or that follow from the value.
_READER_FIELDS = ("id", "seq", "t0_ns", "t1_ns", "frame", "child", "producer")


def create_ros_log(path: Path, mapping: LogMap, *, schemas: str = ROS2) -> RosWriter:
    """Return the writer of ``NAME.bag``, ``NAME.mcap`` or the folder of a ROS 2 bag.

    With schemas of Foxglove, an MCAP file has messages of ROS 2 where these lack the content.
    Raises InputError if the folder exists, and StorageError if the file cannot be written.
    """
    make_folder(path.resolve().parent)
    with storage_errors(path):
        storage = _STORAGES[path.suffix.lower(), schemas](path)
        return RosWriter(storage, mapping, str(path))


class RosWriter(LogSink):
    """Writes samples as messages of ROS, each type as its usual message.

    Types without one become ``infuse_msgs/Asn1Bitstream``. Poses are also in the frame tree ``/tf``, except
    true ones, and those of a frame that another stream has placed.

    Parameters
    ----------
    storage : MessageStorage
    mapping : LogMap
        Topics of all streams.
    name : str
        Name of the log in messages.
    """

    def __init__(self, storage: MessageStorage, mapping: LogMap, name: str) -> None:
        self._storage, self._mapping, self._name = storage, mapping, name
        self._names, self._written_names = OriginalNames(), -1
        self._targets: dict[str, tuple[Target, Encoder]] = {}
        self._keys: dict[tuple[str, str], Any] = {}
        self._frames: dict[str, str] = {}
        self._parents: dict[str, str] = {}
        self._anchors = dict(mapping.anchors)
        self._losses: Counter[Loss] = Counter()
        self._substitutes: Counter[Substitute] = Counter()
        self._last_ns = 0
        self._closed = False

    @property
    def losses(self) -> Mapping[Loss, int]:
        """Number of samples by stream and field that the messages do not hold."""
        return self._losses

    @property
    def substitutes(self) -> Mapping[Substitute, int]:
        """Number of samples of each stream whose messages most programs do not read."""
        return self._substitutes

    def write(self, stream: str, value: Any, stamp_ns: int, header: Header | None = None) -> None:
        """Append a sample.

        A sample that has no message is a loss with its reason.

        Raises
        ------
        InputError
            If the map has no topic for the stream, or a message that its type does not have.
        StorageError
            If it cannot be written.
        """
        type_name = type(value).ASN1_NAME
        if stream not in self._targets:
            self._targets[stream] = self._target(stream, value, header)
        target, encode = self._targets[stream]
        self._note_anchor(value)
        try:
            encoded = self._encoded(stream, encode, value, target, stamp_ns)
        except (InputError, CodecError, ValueError, OverflowError) as error:
            self._losses[stream, f"sample not written: {error}"] += 1
            return
        if self._names.streams.setdefault(encoded.read_as, (stream, type_name)) != (stream, type_name):
            raise InputError(
                f"{self._name}: {stream} and another stream would both be read as {encoded.read_as}"
            )
        if encoded.messages and encoded.messages[0].type_name == FIX and target.local_frame is not None:
            self._names.local_frames[encoded.read_as] = target.local_frame.row
        if (mount := mount_row(value)) is not None:
            self._names.mounts.setdefault(stream, mount)
        outgoing = (*encoded.messages, *self._tree(stream, value, target, stamp_ns))
        self._last_ns = max(self._last_ns, stamp_ns)
        with storage_errors(self._name):
            self._write_names()
            for out in outgoing:
                self._add(out, stamp_ns)
        if encoded.messages and (reason := self._storage.types.remark(encoded.messages[0].type_name)):
            self._substitutes[stream, encoded.messages[0].type_name, reason] += 1
        self._report(stream, value, encoded, header)

    def _encoded(self, stream: str, encode: Encoder, value: Any, target: Target, stamp_ns: int) -> Encoded:
        """Return the messages of a sample; a value that its message cannot hold becomes a bitstream."""
        try:
            return encode(value, target, self._storage.types, stamp_ns)
        except (InputError, ValueError, OverflowError):
            is_first = not any(known[0] == stream for known in self._names.streams.values())
            if encode is bitstream or not is_first:
                raise
            self._targets[stream] = (target, bitstream)
            return bitstream(value, target, self._storage.types, stamp_ns)

    def _note_anchor(self, value: Any) -> None:
        """Keep the location of a frame whose pose on the Earth a sample states."""
        if not isinstance(value, TransformWithCovariance) or value.parent_frame != EARTH:
            return
        with suppress(InputError):  # a frame that is not level has no messages of positions
            frame = value.child_frame
            located = LocalFrame.of_transform(self._new_frame(frame), value.transform.matrix)
            self._anchors.setdefault(frame, located.anchor)

    def _target(self, stream: str, value: Any, header: Header | None) -> tuple[Target, Encoder]:
        if stream not in self._mapping.streams:
            raise InputError(
                f"{self._name}: stream {stream} has no topic; the map has {len(self._mapping.streams)}"
            )
        chosen = self._mapping.streams[stream]
        robot = stream.removeprefix("/").partition("/")[0].partition(".")[0]
        self._names.robot = self._names.robot or robot
        frame = header.frame if header is not None else stream.removeprefix("/").rpartition(".")[0]
        target = Target(chosen.to, robot, frame, self._new_frame, self._names.frames, {})
        message = chosen.message
        if isinstance(value, TransformWithCovariance) and value.parent_frame in self._anchors:
            if message == FIX or (not message and is_position(value)):
                frame_id = self._new_frame(value.parent_frame)
                target = replace(target, local_frame=LocalFrame(frame_id, self._anchors[value.parent_frame]))
                message = FIX
        elif message == FIX:
            raise InputError(
                f"--map: {FIX} for {stream}: the location of its frame {value.parent_frame!r} is not known; "
                "expected an entry under anchors"
            )
        return target, encoder(type(value).ASN1_NAME, message)

    def _new_frame(self, frame: str) -> str:
        """Return the name of a frame in the messages, which no other frame has."""
        if frame not in self._frames:
            name = self._mapping.frame(frame)
            if self._names.frames.get(name, frame) != frame:
                name = frame
            self._frames[frame] = name
            self._names.frames[name] = frame
        return self._frames[frame]

    def _tree(self, stream: str, value: Any, target: Target, stamp_ns: int) -> list[Outgoing]:
        """Return the message of the frame tree for an estimated pose; none for ground truth and positions only."""
        if type(value).ASN1_NAME != "TransformWithCovariance" or target.topic.startswith("/truth"):
            return []
        if not value.is_set or is_position(value):
            return []
        if self._parents.setdefault(value.child_frame, stream) != stream:
            return []
        types = self._storage.types
        transforms = [transform_message(value, target, types, stamp_ns)]
        return [Outgoing(*_FRAME_TREE, types.make("tf2_msgs/TFMessage", transforms=transforms))]

    def _add(self, out: Outgoing, stamp_ns: int) -> None:
        key = out.topic, out.type_name
        if key not in self._keys:
            self._keys[key] = self._storage.add_topic(*key)
        data = self._storage.types.serialize(out.message, out.type_name)
        self._storage.write(self._keys[key], stamp_ns, data)

    def _write_names(self) -> None:
        """Write the names of the original log if some were added."""
        if self._names.entry_count == self._written_names:
            return
        self._written_names = self._names.entry_count
        text = self._storage.types.make("std_msgs/String", data=self._names.to_json())
        self._add(Outgoing(NAMES_TOPIC, "std_msgs/msg/String", text), self._last_ns)

    def _report(self, stream: str, value: Any, encoded: Encoded, header: Header | None) -> None:
        """Count the fields of a sample that its messages do not hold."""
        written_value = with_mount(encoded.held, self._names.mounts.get(stream))
        paths = differing_fields(value, written_value, ROUNDING) if written_value is not value else []
        for path in {".".join(path.split(".")[:_PATH_LENGTH]): None for path in paths}:
            self._losses[stream, path] += 1
        for name in _lost_fields(stream, header):
            self._losses[stream, f"header.{name}"] += 1
        if header is not None and encoded.messages[0].type_name in self._storage.types.without_frame:
            self._losses[stream, "header.frame"] += 1

    def close(self) -> None:
        """Complete the file."""
        if self._closed:
            return
        self._closed = True
        with storage_errors(self._name):
            self._write_names()
            self._storage.close()

    def keep(self) -> None:
        """Give an incomplete log its name."""
        with storage_errors(self._name):
            self._storage.keep()

    def __exit__(self, *error: object) -> None:
        if error[0] is None:
            try:
                self.close()
            except StorageError:
                self._storage.abort()
                raise
        elif not self._closed:
            self._closed = True
            self._storage.abort()


def _lost_fields(stream: str, header: Header | None) -> list[str]:
    """Return the fields of a header that a header of the reader does not have."""
    if header is None or stream.count("/") != 2:
        return []
    plain = recorded_header(stream, header.seq, header.t0_ns)
    names = [name for name in Header.__dataclass_fields__ if name not in _READER_FIELDS]
    return [name for name in names if getattr(header, name) != getattr(plain, name)]

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files to which the writer of ROS messages adds serialised messages."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any, Protocol, cast

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from cdff_common.errors import InputError
from services.ros_messages.message_types import RosTypes


class MessageStorage(Protocol):
    """A new file or folder with messages; complete and under its name when it is closed."""

    types: RosTypes

    def add_topic(self, topic: str, type_name: str) -> Any:
        """Return the key of a new topic."""

    def write(self, key: Any, stamp_ns: int, data: memoryview | bytes) -> None:
        """Append a message."""

    def close(self) -> None:
        """Complete the file."""

    def abort(self) -> None:
        """Remove the file."""


class Bag1Storage(MessageStorage):
    """A ROS 1 bag without compression."""

    def __init__(self, path: Path) -> None:
        self.types = RosTypes(1)
        self._path, self._part = path, path.with_name(f"{path.name}.part")
        self._part.unlink(missing_ok=True)
        self._writer = Writer1(self._part)
        self._writer.open()

    def add_topic(self, topic: str, type_name: str) -> Any:
        """Return the connection of a new topic."""
        return self._writer.add_connection(topic, type_name, typestore=self.types.store)

    def write(self, key: Any, stamp_ns: int, data: memoryview | bytes) -> None:
        """Append a message."""
        self._writer.write(key, stamp_ns, data)

    def close(self) -> None:
        """Write the index and give the file its name."""
        self._writer.close()
        self._part.replace(self._path)

    def abort(self) -> None:
        """Remove the file."""
        self._writer.close()
        self._part.unlink(missing_ok=True)


class Bag2Storage(MessageStorage):
    """The folder of a ROS 2 bag with an SQLite database; raises InputError if the folder exists."""

    def __init__(self, path: Path) -> None:
        if path.exists():
            raise InputError(f"log {path}: exists already; remove it, or name another folder")
        self.types = RosTypes(2)
        self._path = path
        self._writer = Writer2(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
        self._writer.open()

    def add_topic(self, topic: str, type_name: str) -> Any:
        """Return the connection of a new topic."""
        return self._writer.add_connection(topic, type_name, typestore=self.types.store)

    def write(self, key: Any, stamp_ns: int, data: memoryview | bytes) -> None:
        """Append a message."""
        self._writer.write(key, stamp_ns, data)

    def close(self) -> None:
        """Write the metadata."""
        self._writer.close()

    def abort(self) -> None:
        """Remove the folder."""
        self._writer.close()
        shutil.rmtree(self._path)


class McapStorage(MessageStorage):
    """An MCAP file with ROS 2 messages in CDR, without compression."""

    def __init__(self, path: Path) -> None:
        from mcap.writer import CompressionType, Writer

        self.types = RosTypes(2)
        self._path, self._part = path, path.with_name(f"{path.name}.part")
        self._file = self._part.open("wb")
        self._writer = Writer(self._file, compression=CompressionType.NONE)
        self._writer.start(profile="ros2", library="cdff")
        self._schemas: dict[str, int] = {}

    def add_topic(self, topic: str, type_name: str) -> Any:
        """Return the id of the channel of a new topic."""
        if type_name not in self._schemas:
            definition, _ = self.types.store.generate_msgdef(type_name, ros_version=2)
            self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", definition.encode())
        metadata = {"offered_qos_profiles": ""}
        return self._writer.register_channel(topic, "cdr", self._schemas[type_name], metadata)

    def write(self, key: Any, stamp_ns: int, data: memoryview | bytes) -> None:
        """Append a message."""
        # The writer copies any buffer into its chunk.
        self._writer.add_message(key, stamp_ns, cast("bytes", data), stamp_ns)

    def close(self) -> None:
        """Write the index and give the file its name."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()
        self._part.replace(self._path)

    def abort(self) -> None:
        """Remove the file."""
        self._file.close()
        self._part.unlink(missing_ok=True)

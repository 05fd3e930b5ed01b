# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files to which the writer of ROS messages adds serialised messages."""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Protocol, cast

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

from cdff_common.clock import monotonic_s
from cdff_common.errors import InputError
from cdff_dev.logs.formats.ros.foxglove_types import FoxgloveTypes
from services.ros_messages.message_types import RosTypes

#: Time and size of messages after which they are committed to a database: a process that is killed loses
#: later ones.
_COMMIT_S, _COMMIT_BYTES = 1.0, 16_000_000


class MessageStorage(Protocol):
    """A new file or folder with messages; complete and under its name when it is closed."""

    types: RosTypes

    def add_topic(self, topic: str, type_name: str) -> Any:
        """Return the key of a new topic."""

    def write(self, key: Any, stamp_ns: int, data: memoryview | bytes) -> None:
        """Append a message."""

    def close(self) -> None:
        """Complete the file."""

    def keep(self) -> None:
        """Give a file that cannot be completed its name: it is read up to its end."""

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

    def keep(self) -> None:
        """Give the file its name without its index."""
        self._close_file()
        self._part.replace(self._path)

    def abort(self) -> None:
        """Remove the file."""
        self._close_file()
        self._part.unlink(missing_ok=True)

    def _close_file(self) -> None:
        """Close the file without its index; on a full disk also without its last bytes."""
        with suppress(OSError):
            if self._writer.bio is not None:
                self._writer.bio.close()


class Bag2Storage(MessageStorage):
    """The folder of a ROS 2 bag with an SQLite database.

    Raises InputError if the folder exists, or its path has a character that rosbags does not write.
    """

    def __init__(self, path: Path) -> None:
        if path.exists():
            raise InputError(f"log {path}: exists already; remove it, or name another folder")
        if forbidden := sorted(set("#?%") & set(str(path.resolve()))):
            # rosbags opens the database by a URI in which these have another meaning.
            raise InputError(
                f"log {path}: {' '.join(forbidden)} cannot be in the path of a new ROS 2 bag; write it "
                "elsewhere and move it, or write NAME.mcap"
            )
        self.types = RosTypes(2)
        self._path = path
        self._writer = Writer2(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
        try:
            with _database_errors():
                self._writer.open()
                storage = self._writer.storage
                assert isinstance(storage, Sqlite3Writer)
                # The connection of rosbags is bound to this thread; a recorder writes from those of the bus.
                storage.conn.close()
                storage.conn = self._database = sqlite3.connect(storage.path, check_same_thread=False)
                storage.cursor = self._database.cursor()
        except BaseException:  # such as Ctrl-C
            shutil.rmtree(path, ignore_errors=True)
            raise
        self._uncommitted_bytes, self._committed_s = 0, monotonic_s()

    def add_topic(self, topic: str, type_name: str) -> Any:
        """Return the connection of a new topic."""
        with _database_errors():
            return self._writer.add_connection(topic, type_name, typestore=self.types.store)

    def write(self, key: Any, stamp_ns: int, data: memoryview | bytes) -> None:
        """Append a message."""
        with _database_errors():
            self._writer.write(key, stamp_ns, data)
            self._uncommitted_bytes += len(data)
            if self._uncommitted_bytes > _COMMIT_BYTES or monotonic_s() - self._committed_s > _COMMIT_S:
                self._database.commit()
                self._uncommitted_bytes, self._committed_s = 0, monotonic_s()

    def close(self) -> None:
        """Write the metadata."""
        with _database_errors():
            self._writer.close()

    def keep(self) -> None:
        """Close the database without the messages that were not committed."""
        self._database.close()

    def abort(self) -> None:
        """Remove the folder."""
        self._database.close()
        shutil.rmtree(self._path)


@contextmanager
def _database_errors() -> Iterator[None]:
    """Convert an error of SQLite, such as of a full disk, to an OSError."""
    try:
        yield
    except sqlite3.Error as error:
        raise OSError(str(error)) from error


class McapStorage(MessageStorage):
    """An MCAP file with ROS 2 messages in CDR, without compression."""

    _profile = "ros2"

    def __init__(self, path: Path) -> None:
        from mcap.writer import CompressionType, Writer

        self.types = RosTypes(2)
        self._path, self._part = path, path.with_name(f"{path.name}.part")
        self._file = self._part.open("wb")
        self._writer = Writer(self._file, compression=CompressionType.NONE)
        self._writer.start(profile=self._profile, library="cdff")
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

    def keep(self) -> None:
        """Give the file its name without its index."""
        with suppress(OSError):
            self._file.close()
        self._part.replace(self._path)

    def abort(self) -> None:
        """Remove the file."""
        with suppress(OSError):  # of a full disk, which the last bytes cannot be written to
            self._file.close()
        self._part.unlink(missing_ok=True)


class FoxgloveStorage(McapStorage):
    """An MCAP file with messages of Foxglove's schemas; others are ROS 2 messages in CDR.

    Parameters
    ----------
    path : Path
    encoding : str
        ``protobuf`` or ``json``.
    """

    _profile = ""

    def __init__(self, path: Path, encoding: str) -> None:
        super().__init__(path)
        self.types = self._foxglove = FoxgloveTypes(encoding)

    def add_topic(self, topic: str, type_name: str) -> Any:
        """Return the id of the channel of a new topic."""
        schema = self._foxglove.schema(type_name)
        if schema is None:
            return super().add_topic(topic, type_name)
        if type_name not in self._schemas:
            self._schemas[type_name] = self._writer.register_schema(*schema)
        return self._writer.register_channel(topic, self._foxglove.encoding, self._schemas[type_name])

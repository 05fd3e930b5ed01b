# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""SQLite databases of ROS 2 bags, complete or damaged."""

from __future__ import annotations

import io
import sqlite3
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

import zstandard

from cdff_common.errors import CodecError, InputError
from cdff_dev.logs.formats.ros.decoders import (
    DECODER_ERRORS,
    Decoder,
    decoder,
    decoder_or_fault,
    standard_decoder,
)
from cdff_dev.logs.formats.ros.file_recording import FileRecording
from cdff_dev.logs.formats.ros.recording import Channel, Encoded

#: Largest row of the database, and largest message after decompression.
_MAX_BYTES = 256 << 20
#: Number of rows after damage that are tried one by one, because a page of a table has hundreds of rows;
#: then the distance doubles, up to the last row.
_NEAR_ROWS, _LAST_ROW = 512, 1 << 62


class Bag2Database(FileRecording):
    """The database of a ROS 2 bag (storage plug-in sqlite3).

    Of a truncated or damaged database the readable pages are read; the first damaged row is logged and
    listed in ``unconverted``. Messages of a bag without definitions (before ROS 2 Iron) are decoded if their
    types are standard.

    Parameters
    ----------
    path : Path
    is_compressed : bool
        Whether each message is compressed with zstd.

    Raises
    ------
    CodecError
        If it is not the database of a bag.
    """

    def __init__(self, path: Path, is_compressed: bool = False) -> None:
        super().__init__(path)
        self._is_compressed = is_compressed
        self._ends_early = False
        self._database = sqlite3.connect(":memory:")
        try:
            self._list_missing_pages()
            self._database = _connect(path)
            self._channels = self._read_channels()
        except (sqlite3.Error, *DECODER_ERRORS) as error:
            self._database.close()
            raise CodecError(
                f"{path}: not the database of a ROS 2 bag: {error}; expected tables topics and messages"
            ) from error
        self._list_write_ahead_log()

    def messages(self, channels: Collection[Channel]) -> Iterator[tuple[Channel, int, Encoded]]:
        """Yield channel, time of recording and encoded message in the order of recording."""
        chosen = {channel.key: channel for channel in channels}
        if not chosen:
            return
        condition = f"topic_id IN ({', '.join(str(key) for key in chosen)})"
        for topic, recorded_ns, data in self._rows("topic_id, timestamp, data", condition):
            if topic in chosen and isinstance(recorded_ns, int) and isinstance(data, bytes):
                try:
                    raw = _decompressed(data) if self._is_compressed else data
                except (zstandard.ZstdError, ValueError) as error:
                    self._report("compressed message", f"{chosen[topic].topic}: {error}")
                    continue
                yield chosen[topic], recorded_ns, raw
            else:
                self._report("row", "its time is not a number, or its data are not bytes")

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def _read_channels(self) -> list[Channel]:
        """Return the topics with the numbers of their messages."""
        topic_rows = self._database.execute("SELECT * FROM topics")
        columns = [column[0] for column in topic_rows.description]
        topics = [dict(zip(columns, row, strict=True)) for row in topic_rows]
        definitions = self._definitions()
        counts = Counter(topic for (topic,) in self._rows("topic_id", "TRUE"))
        return [self._channel(topic, counts[topic["id"]], definitions) for topic in topics]

    def _definitions(self) -> dict[str, tuple[str, bytes, str]] | None:
        """Return encoding, definition and hash by type; None if the bag has none."""
        try:
            definition_rows = self._database.execute(
                "SELECT topic_type, encoding, encoded_message_definition, type_description_hash "
                "FROM message_definitions"
            )
            return {
                name: (encoding, text.encode(), digest or "")
                for name, encoding, text, digest in definition_rows
            }
        except sqlite3.Error as error:
            if "no such table" not in str(error):
                self._report("message definitions", str(error))
            return None

    def _channel(
        self, topic: Mapping[str, Any], count: int, definitions: Mapping[str, tuple[str, bytes, str]] | None
    ) -> Channel:
        name, number, encoding = str(topic["type"]), topic["id"], topic["serialization_format"]
        if not isinstance(number, int):
            raise InputError(f"topic {topic['name']!r} with the number {number!r}")
        if encoding != "cdr":
            decoder_or_error: Decoder | str = f"messages in {encoding!r}, expected 'cdr'"
        elif definitions and name in definitions and definitions[name][0] != "unknown":
            decoder_or_error = decoder_or_fault(lambda: _defined(name, *definitions[name]))
        else:
            decoder_or_error = decoder_or_fault(lambda: standard_decoder(name))
        if callable(decoder_or_error):
            self._decoders[number] = decoder_or_error
        fault = decoder_or_error if isinstance(decoder_or_error, str) else ""
        return Channel(str(topic["name"]), name, count, number, "cdr", fault=fault)

    def _rows(self, columns: str, condition: str) -> Iterator[tuple[Any, ...]]:
        """Yield rows of messages in their order, those before and after damaged pages."""
        chosen = f"rowid > ? AND {condition} ORDER BY rowid"
        query = f"SELECT rowid, {columns} FROM messages NOT INDEXED WHERE {chosen}"
        last, step = -1 << 62, 0
        while last < _LAST_ROW:
            try:
                for row in self._database.execute(query, (last,)):
                    if row[0] <= last:
                        raise sqlite3.DatabaseError("rows are not in order")
                    last, step = row[0], 0
                    yield row[1:]
            except (sqlite3.Error, MemoryError, OverflowError) as error:
                if not self._ends_early:
                    self._report("damaged page", f"after row {max(last, 0)}: {error}")
                last = max(last, 0) + (1 if step < _NEAR_ROWS else 1 << min(step - _NEAR_ROWS, 62))
                step += 1
            else:
                return

    def _list_missing_pages(self) -> None:
        """List the end of a file that has fewer pages than its header states."""
        size = self._path.stat().st_size
        with self._path.open("rb") as file:
            header = file.read(100)
        page_bytes = int.from_bytes(header[16:18]) if header[16:18] != b"\0\1" else 1 << 16
        stated_bytes = int.from_bytes(header[28:32]) * page_bytes if header[24:28] == header[92:96] else size
        self._ends_early = size < stated_bytes
        if self._ends_early:
            self._report(
                f"byte {size}", f"the file ends here, of {stated_bytes} bytes; its other pages are read"
            )

    def _list_write_ahead_log(self) -> None:
        """List messages that a recorder has not yet moved into the database when it was ended."""
        log = self._path.with_name(f"{self._path.name}-wal")
        if log.is_file() and (size := log.stat().st_size):
            reason = (
                f"{size} bytes of the end of the recording: open the database once with sqlite3 to add them"
            )
            self._report(log.name, reason)


def _connect(path: Path) -> sqlite3.Connection:
    """Open a database for reading, also one with fewer pages than it states."""
    address = f"file:{quote(str(path.resolve()))}?mode=ro&immutable=1"
    database = sqlite3.connect(address, uri=True, check_same_thread=False)
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _MAX_BYTES)
    # Without it, SQLite refuses a truncated file; nothing is written, since the file is open for reading.
    database.execute("PRAGMA writable_schema = ON")
    return database


def _defined(name: str, encoding: str, definition: bytes, digest: str) -> Decoder:
    return decoder("cdr", encoding, name, definition, digest)


def _decompressed(data: bytes) -> bytes:
    raw = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data)).read(_MAX_BYTES + 1)
    if len(raw) > _MAX_BYTES:
        raise ValueError(f"a message of more than {_MAX_BYTES} bytes")
    return bytes(raw)

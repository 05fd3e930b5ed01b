# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bags of ROS 1 and ROS 2, read by rosbags."""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import apsw
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.rosbag1 import ReaderError as Bag1Error
from rosbags.rosbag2 import ReaderError as Bag2Error

from cdff_common.errors import CodecError
from cdff_dev.logs.formats.ros.recording import PARSER_ERRORS, Channel, Recording
from cdff_dev.logs.source import Unconverted

_log = logging.getLogger(__name__)
_ERRORS = (*PARSER_ERRORS, AnyReaderError, Bag1Error, Bag2Error, apsw.Error)


class BagRecording(Recording):
    """One or several ROS 1 bags of one recording, or one ROS 2 bag: its folder, or a single file.

    Raises
    ------
    CodecError
        If a file is not a bag, or its message definitions are missing.
    """

    def __init__(self, files: list[Path]) -> None:
        self._name = str(files[0])
        self._unconverted: dict[str, Unconverted] = {}
        try:
            self._reader = AnyReader(files)
            self._reader.open()
        except _ERRORS as error:
            raise CodecError(f"{self._name}: not a readable bag: {_text(error)}") from error
        encoding = "cdr" if self._reader.is2 else "ros1"
        self._channels = {
            id(c): Channel(c.topic, c.msgtype, c.msgcount, c, encoding) for c in self._reader.connections
        }

    @property
    def name(self) -> str:
        """Path of the file or folder."""
        return self._name

    @property
    def channels(self) -> Sequence[Channel]:
        """Types and topics of the messages."""
        return list(self._channels.values())

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """The end of a damaged bag."""
        return self._unconverted

    def messages(self, channels: Collection[Channel]) -> Iterator[tuple[Channel, int, bytes]]:
        """Yield channel, time of recording and encoded message in the order of time, up to any damage."""
        messages = self._reader.messages([channel.key for channel in channels]) if channels else iter(())
        while True:
            try:
                connection, recorded_ns, raw = next(messages)
            except StopIteration:
                return
            except _ERRORS as error:
                self._report(_text(error))
                return
            yield self._channels[id(connection)], recorded_ns, bytes(raw)

    def decode(self, channel: Channel, raw: bytes) -> Any:
        """Return a message; raises CodecError if it is damaged."""
        try:
            return self._reader.deserialize(raw, channel.type_name)
        except _ERRORS as error:
            raise CodecError(f"{self._name}: {channel.topic}: {_text(error)}") from error

    def close(self) -> None:
        """Close the files."""
        if self._reader.stack:
            self._reader.close()

    def _report(self, reason: str) -> None:
        if not self._unconverted:
            _log.warning("%s: damaged; messages after the damage are not read: %s", self._name, reason)
            self._unconverted["damage"] = Unconverted("damaged part", 1, f"{reason}; the remainder is lost")


def _text(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Interface of recordings of messages: bags, and MCAP files."""

from __future__ import annotations

import heapq
import re
import struct
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from cdff_dev.logs.source import Unconverted

#: An encoded message, which can be a part of a chunk.
Encoded = bytes | memoryview
#: Errors of the parsers of other projects for damaged bytes, besides their own.
PARSER_ERRORS = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    LookupError,
    MemoryError,
    OSError,
    RuntimeError,  # also RecursionError, for types that contain themselves
    SyntaxError,
    TypeError,
    ValueError,
    struct.error,
)
#: Bytes of the stamp of a message that begins with a header: seconds and nanoseconds, in ROS 1 after the
#: sequence number, in CDR after the encapsulation, whose second byte is the byte order.
_STAMP = slice(4, 12)
#: Messages below this size are copied, so that they do not keep their whole chunk in memory.
_SMALL_BYTES = 1 << 16
#: Beginning of a message of Foxglove in JSON.
_JSON_STAMP = re.compile(rb'\{\s*"timestamp":\s*\{\s*"sec":\s*(\d{1,10}),\s*"nsec":\s*(\d{1,9})\s*\}')


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """Messages of one type on one topic.

    Attributes
    ----------
    topic : str
    type_name : str
        Message type as named by ROS 2, such as ``sensor_msgs/msg/Imu``.
    count : int
        Number of messages.
    key : Any
        Identification in the recording.
    encoding : str
        ``ros1``, ``cdr``, or another encoding, whose messages are decoded for their stamps.
    original_type : str
        Type in the recording, if it is not ``type_name``.
    fault : str
        Reason why the messages cannot be decoded; empty if they can.
    """

    topic: str
    type_name: str
    count: int
    key: Any
    encoding: str = "cdr"
    original_type: str = ""
    fault: str = ""


class Recording(Protocol):
    """Messages in the order of recording, which are decoded on request."""

    @property
    def name(self) -> str:
        """Path of the file or folder, for messages."""

    @property
    def channels(self) -> Sequence[Channel]:
        """Types and topics of the messages."""

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """Content that is not a message, and damaged parts."""
        return {}

    def messages(self, channels: Collection[Channel]) -> Iterator[tuple[Channel, int, Encoded]]:
        """Yield channel, time of recording and encoded message; ends at damaged content."""

    def decode(self, channel: Channel, raw: Encoded) -> Any:
        """Return a message with the fields of its type in ROS; raises CodecError if it is damaged."""

    def close(self) -> None:
        """Close the files."""


class JoinedRecording(Recording):
    """Several files of one recording: messages in the order of time, if those of each file are."""

    def __init__(self, name: str, parts: Sequence[Recording], missing: Mapping[str, Unconverted]) -> None:
        self._name, self._parts, self._missing = name, parts, missing
        self._owners = {id(channel): part for part in parts for channel in part.channels}

    @property
    def name(self) -> str:
        """Path of the folder or first file."""
        return self._name

    @property
    def channels(self) -> Sequence[Channel]:
        """Types and topics of the messages of all files."""
        return [channel for part in self._parts for channel in part.channels]

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """Damaged parts of the files, and files that are not read."""
        contents = dict(self._missing)
        for part in self._parts:
            prefix = f"{Path(part.name).name}: " if len(self._parts) > 1 else ""
            contents |= {f"{prefix}{name}": item for name, item in part.unconverted.items()}
        return contents

    def messages(self, channels: Collection[Channel]) -> Iterator[tuple[Channel, int, Encoded]]:
        """Yield channel, time of recording and encoded message."""
        of_parts = [[c for c in channels if self._owners[id(c)] is part] for part in self._parts]
        messages_of_parts = [
            part.messages(chosen) for part, chosen in zip(self._parts, of_parts, strict=True)
        ]
        return heapq.merge(*messages_of_parts, key=lambda message: message[1])

    def decode(self, channel: Channel, raw: Encoded) -> Any:
        """Return a message; raises CodecError if it is damaged."""
        return self._owners[id(channel)].decode(channel, raw)

    def close(self) -> None:
        """Close the files."""
        for part in self._parts:
            part.close()


def kept(message: memoryview) -> Encoded:
    """Return a message of a chunk; a small message is copied, so that it does not hold the chunk."""
    return bytes(message) if len(message) < _SMALL_BYTES else message


def encoded_stamp_ns(encoding: str, raw: Encoded) -> int:
    """Return the stamp of an encoded message of ROS or in JSON that begins with it; 0 if it does not."""
    if encoding == "json":
        stamp_match = _JSON_STAMP.match(raw)
        return int(stamp_match[1]) * 1_000_000_000 + int(stamp_match[2]) if stamp_match else 0
    if encoding not in ("ros1", "cdr") or len(raw) < _STAMP.stop:
        return 0
    order = ">" if encoding == "cdr" and raw[1] == 0 else "<"
    seconds, nanoseconds = np.frombuffer(raw[_STAMP], f"{order}u4")
    return int(seconds) * 1_000_000_000 + int(nanoseconds)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ROS 1 bags, complete or without their index or end."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from cdff_common.errors import CodecError
from cdff_dev.logs.formats.ros.bag1_fields import Bag1Connection
from cdff_dev.logs.formats.ros.bag1_records import Bag1Records
from cdff_dev.logs.formats.ros.decoders import DECODER_ERRORS, Decoder, decoder, decoder_or_fault
from cdff_dev.logs.formats.ros.recording import Channel, Encoded, Recording, kept
from cdff_dev.logs.source import Unconverted

_log = logging.getLogger(__name__)


class Bag1Recording(Recording):
    """A ROS 1 bag.

    A bag that was not completed (``.bag.active``), or whose index is damaged, is read sequentially up to its
    end; damaged chunks are left out. Both are logged and listed in ``unconverted``.

    Raises
    ------
    CodecError
        If it is not a bag of version 2.0.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._unconverted: dict[str, Unconverted] = {}
        self._records = Bag1Records(path, self._report)
        connections: dict[int, Bag1Connection] = {}
        counts: Counter[int] = Counter()
        index = self._records.index
        for record in self._records.messages() if index is None else index.connections:
            if isinstance(record, Bag1Connection):
                connections.setdefault(record.number, record)
            else:
                counts[record[0]] += 1
        for chunk in index.chunks.values() if index else ():
            counts.update(chunk)
        self._decoders: dict[int, Decoder] = {}
        self._channels = [self._channel(c, counts[c.number]) for c in connections.values()]
        if unknown := sum(count for number, count in counts.items() if number not in connections):
            self._unconverted["messages"] = Unconverted("unknown", unknown, "their connection is missing")

    @property
    def name(self) -> str:
        """Path of the file."""
        return str(self._path)

    @property
    def channels(self) -> Sequence[Channel]:
        """Types and topics of the messages."""
        return self._channels

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """Damaged parts, and the end of a bag that was not completed."""
        return self._unconverted

    def messages(self, channels: Collection[Channel]) -> Iterator[tuple[Channel, int, Encoded]]:
        """Yield channel, time of recording and encoded message in the order of the file."""
        chosen = {channel.key: channel for channel in channels}
        if not chosen:
            return
        for record in self._records.messages(set(chosen)):
            if isinstance(record, tuple) and (channel := chosen.get(record[0])) is not None:
                yield channel, record[1], kept(record[2])

    def decode(self, channel: Channel, raw: Encoded) -> Any:
        """Return a message with the fields of its type; raises CodecError if it is damaged."""
        try:
            return self._decoders[channel.key](raw)
        except DECODER_ERRORS as error:
            reason = f"{type(error).__name__}: {error}"
            raise CodecError(f"{self._path}: {channel.topic}: damaged message: {reason}") from error

    def close(self) -> None:
        """Close the file, which is only open while it is read."""

    def _channel(self, connection: Bag1Connection, count: int) -> Channel:
        """Return a channel, and keep its decoder."""
        name = connection.type_name
        found = decoder_or_fault(
            lambda: decoder("ros1", "ros1msg", name, connection.definition, connection.md5sum)
        )
        if callable(found):
            self._decoders[connection.number] = found
        fault = found if isinstance(found, str) else ""
        return Channel(connection.topic, name, count, connection.number, "ros1", fault=fault)

    def _report(self, offset: int, reason: str) -> None:
        name = f"byte {offset}"
        if name not in self._unconverted:
            _log.warning("%s: byte %d: %s", self._path, offset, reason)
            self._unconverted[name] = Unconverted("damaged part", 1, reason)

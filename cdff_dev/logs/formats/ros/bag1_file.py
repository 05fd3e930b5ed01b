# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ROS 1 bags, complete or without their index or end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path

from cdff_dev.logs.formats.ros.bag1_fields import Bag1Connection
from cdff_dev.logs.formats.ros.bag1_records import Bag1Records
from cdff_dev.logs.formats.ros.decoders import decoder, decoder_or_fault
from cdff_dev.logs.formats.ros.file_recording import FileRecording
from cdff_dev.logs.formats.ros.recording import Channel, Encoded, kept
from cdff_dev.logs.source import Unconverted


class Bag1Recording(FileRecording):
    """A ROS 1 bag.

    A bag that was not completed (``.bag.active``), or whose index is damaged, is read sequentially up to its
    end; damaged chunks are left out. Both are logged and listed in ``unconverted``.

    Raises
    ------
    CodecError
        If it is not a bag of version 2.0.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._records = Bag1Records(path, self._report_at)
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
        self._channels = [self._channel(c, counts[c.number]) for c in connections.values()]
        if unknown := sum(count for number, count in counts.items() if number not in connections):
            self._unconverted["messages"] = Unconverted("unknown", unknown, "their connection is missing")

    def messages(self, channels: Collection[Channel]) -> Iterator[tuple[Channel, int, Encoded]]:
        """Yield channel, time of recording and encoded message in the order of the file."""
        chosen = {channel.key: channel for channel in channels}
        if not chosen:
            return
        for record in self._records.messages(set(chosen)):
            if not isinstance(record, tuple):
                continue
            number, recorded_ns, content = record
            if (channel := chosen.get(number)) is not None:
                yield channel, recorded_ns, kept(content)

    def _channel(self, connection: Bag1Connection, count: int) -> Channel:
        """Return the channel of a connection; its decoder is added to the decoders."""
        name = connection.type_name
        decoder_or_error = decoder_or_fault(
            lambda: decoder("ros1", "ros1msg", name, connection.definition, connection.md5sum)
        )
        if callable(decoder_or_error):
            self._decoders[connection.number] = decoder_or_error
        fault = decoder_or_error if isinstance(decoder_or_error, str) else ""
        return Channel(connection.topic, name, count, connection.number, "ros1", fault=fault)

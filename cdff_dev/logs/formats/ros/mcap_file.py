# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MCAP files with messages of ROS 1 and ROS 2, and of Foxglove's schemas in protobuf or JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import mcap.records

from cdff_dev.logs.formats.ros.decoders import Decoder, decoder, decoder_or_fault, ros_type
from cdff_dev.logs.formats.ros.file_recording import FileRecording
from cdff_dev.logs.formats.ros.foxglove import FOXGLOVE
from cdff_dev.logs.formats.ros.mcap_records import McapRecords
from cdff_dev.logs.formats.ros.recording import Channel, Encoded, kept
from cdff_dev.logs.source import Unconverted


class McapRecording(FileRecording):
    """An MCAP file.

    The file is read sequentially; its index is not used, so that files without one and files that end early
    are read up to their end. Damaged chunks are left out. Both are logged and listed in ``unconverted``.

    Raises
    ------
    CodecError
        If it is not an MCAP file.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._records = McapRecords(path, self._report_at)
        schemas: dict[int, mcap.records.Schema] = {}
        channels: dict[int, mcap.records.Channel] = {}
        counts: Counter[int] = Counter()
        for record in self._records:
            if isinstance(record, mcap.records.Schema):
                schemas.setdefault(record.id, record)
            elif isinstance(record, mcap.records.Channel):
                channels.setdefault(record.id, record)
            else:
                counts[record[0]] += 1
        known: dict[tuple[int, str], Decoder | str] = {}
        self._channels = [
            self._channel(channel, schemas.get(channel.schema_id), counts[number], known)
            for number, channel in channels.items()
        ]
        if unknown := sum(count for number, count in counts.items() if number not in channels):
            self._unconverted["messages"] = Unconverted("unknown", unknown, "their channel is missing")
        if count := self._records.attachments:
            self._unconverted["attachments"] = Unconverted("attachment", count, "not a message")

    def messages(self, channels: Collection[Channel]) -> Iterator[tuple[Channel, int, Encoded]]:
        """Yield channel, time of recording and encoded message in the order of the file."""
        chosen = {channel.key: channel for channel in channels}
        if not chosen:
            return
        for record in self._records.records(set(chosen)):
            if not isinstance(record, tuple):
                continue
            number, recorded_ns, content = record
            if (channel := chosen.get(number)) is not None:
                yield channel, recorded_ns, kept(content)

    def _adapted(self, channel: Channel, message: Any) -> Any:
        foxglove = FOXGLOVE.get(channel.original_type)
        return message if foxglove is None else foxglove[1](message)

    def _channel(
        self,
        channel: mcap.records.Channel,
        schema: mcap.records.Schema | None,
        count: int,
        known: dict[tuple[int, str], Decoder | str],
    ) -> Channel:
        """Return a channel; its decoder is added. ``known`` has decoders or faults by schema and encoding."""
        key = channel.schema_id, channel.message_encoding
        if key not in known:
            known[key] = _decoder_or_fault(channel.message_encoding, schema)
        decoder_or_error = known[key]
        if callable(decoder_or_error):
            self._decoders[channel.id] = decoder_or_error
        name = "" if schema is None else schema.name
        type_name, original = name, name
        if name in FOXGLOVE:
            type_name = FOXGLOVE[name][0]
        elif channel.message_encoding in ("ros1", "cdr") and callable(decoder_or_error):
            type_name, original = ros_type(name), ""
        fault = decoder_or_error if isinstance(decoder_or_error, str) else ""
        encoding = channel.message_encoding
        return Channel(channel.topic, type_name, count, channel.id, encoding, original, fault)


def _decoder_or_fault(encoding: str, schema: mcap.records.Schema | None) -> Decoder | str:
    """Return the decoder of messages, or the reason why they cannot be decoded."""
    if schema is None:
        return f"messages in {encoding!r} without a schema"
    return decoder_or_fault(lambda: decoder(encoding, schema.encoding, schema.name, schema.data))

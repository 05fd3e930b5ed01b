# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MCAP files with messages of ROS 1 and ROS 2, and of Foxglove's schemas in protobuf or JSON."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import mcap.records

from cdff_common.errors import CodecError
from cdff_dev.logs.formats.ros.decoders import DECODER_ERRORS, Decoder, decoder, decoder_or_fault, ros_type
from cdff_dev.logs.formats.ros.foxglove import FOXGLOVE
from cdff_dev.logs.formats.ros.mcap_records import McapRecords
from cdff_dev.logs.formats.ros.recording import Channel, Encoded, Recording, kept
from cdff_dev.logs.source import Unconverted

_log = logging.getLogger(__name__)


class McapRecording(Recording):
    """An MCAP file.

    The file is read sequentially; its index is not used, so that files without one and files that end early
    are read up to their end. Damaged chunks are left out. Both are logged and listed in ``unconverted``.

    Raises
    ------
    CodecError
        If it is not an MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._unconverted: dict[str, Unconverted] = {}
        self._records = McapRecords(path, self._report)
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
        self._decoders: dict[int, Decoder] = {}
        known: dict[tuple[int, str], Decoder | str] = {}
        self._channels = {
            number: self._channel(channel, schemas.get(channel.schema_id), counts[number], known)
            for number, channel in channels.items()
        }
        if unknown := sum(count for number, count in counts.items() if number not in channels):
            self._unconverted["messages"] = Unconverted("unknown", unknown, "their channel is missing")
        if count := self._records.attachments:
            self._unconverted["attachments"] = Unconverted("attachment", count, "not a message")

    @property
    def name(self) -> str:
        """Path of the file."""
        return str(self._path)

    @property
    def channels(self) -> Sequence[Channel]:
        """Types and topics of the messages."""
        return list(self._channels.values())

    @property
    def unconverted(self) -> Mapping[str, Unconverted]:
        """Attachments, and damaged parts."""
        return self._unconverted

    def messages(self, channels: Collection[Channel]) -> Iterator[tuple[Channel, int, Encoded]]:
        """Yield channel, time of recording and encoded message in the order of the file."""
        chosen = {channel.key: channel for channel in channels}
        if not chosen:
            return
        for record in self._records.records(set(chosen)):
            if isinstance(record, tuple) and (channel := chosen.get(record[0])) is not None:
                yield channel, record[1], kept(record[2])

    def decode(self, channel: Channel, raw: Encoded) -> Any:
        """Return a message with the fields of its type in ROS; raises CodecError if it is damaged."""
        try:
            message = self._decoders[channel.key](raw)
            adapted = FOXGLOVE.get(channel.original_type)
            return message if adapted is None else adapted[1](message)
        except DECODER_ERRORS as error:
            reason = f"{type(error).__name__}: {error}"
            raise CodecError(f"{self._path}: {channel.topic}: damaged message: {reason}") from error

    def close(self) -> None:
        """Close the file, which is only open while it is read."""

    def _channel(
        self,
        channel: mcap.records.Channel,
        schema: mcap.records.Schema | None,
        count: int,
        known: dict[tuple[int, str], Decoder | str],
    ) -> Channel:
        """Return a channel, and keep its decoder; ``known`` are decoders or faults by schema and encoding."""
        key = channel.schema_id, channel.message_encoding
        if key not in known:
            known[key] = _decoder_or_fault(channel.message_encoding, schema)
        found = known[key]
        if callable(found):
            self._decoders[channel.id] = found
        name = "" if schema is None else schema.name
        type_name, original = name, name
        if name in FOXGLOVE:
            type_name = FOXGLOVE[name][0]
        elif channel.message_encoding in ("ros1", "cdr") and callable(found):
            type_name, original = ros_type(name), ""
        fault = found if isinstance(found, str) else ""
        encoding = channel.message_encoding
        return Channel(channel.topic, type_name, count, channel.id, encoding, original, fault)

    def _report(self, offset: int, reason: str) -> None:
        name = f"byte {offset}"
        if name not in self._unconverted:
            _log.warning("%s: byte %d: %s; not read", self._path, offset, reason)
            self._unconverted[name] = Unconverted("damaged part", 1, reason)


def _decoder_or_fault(encoding: str, schema: mcap.records.Schema | None) -> Decoder | str:
    """Return the decoder of messages, or the reason why they cannot be decoded."""
    if schema is None:
        return f"messages in {encoding!r} without a schema"
    return decoder_or_fault(lambda: decoder(encoding, schema.encoding, schema.name, schema.data))

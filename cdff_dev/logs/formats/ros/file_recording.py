# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings in one file: each channel has a decoder, and damage is reported once."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cdff_common.errors import CodecError
from cdff_dev.logs.formats.ros.decoders import DECODER_ERRORS, Decoder
from cdff_dev.logs.formats.ros.recording import Channel, Encoded, Recording
from cdff_dev.logs.source import Unconverted

_log = logging.getLogger(__name__)


class FileRecording(Recording):
    """A file of messages, opened while it is read. A subclass lists the channels and their decoders."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._channels: Sequence[Channel] = ()
        self._decoders: dict[Any, Decoder] = {}
        self._unconverted: dict[str, Unconverted] = {}

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
        """Content that is not a message, and damaged parts."""
        return self._unconverted

    def decode(self, channel: Channel, raw: Encoded) -> Any:
        """Return a message with the fields of its type in ROS; raises CodecError if it is damaged."""
        try:
            return self._adapted(channel, self._decoders[channel.key](raw))
        except DECODER_ERRORS as error:
            reason = f"{type(error).__name__}: {error}"
            raise CodecError(f"{self._path}: {channel.topic}: damaged message: {reason}") from error

    def close(self) -> None:
        """Release what stays open between two reads: nothing."""

    def _adapted(self, channel: Channel, message: Any) -> Any:
        """Return a decoded message with the fields of the type in ROS."""
        return message

    def _report(self, name: str, reason: str) -> None:
        """Log and list a damaged part, once for each name."""
        if name not in self._unconverted:
            _log.warning("%s: %s: %s", self._path, name, reason)
            self._unconverted[name] = Unconverted("damaged part", 1, reason)

    def _report_at(self, offset: int, reason: str) -> None:
        self._report(f"byte {offset}", reason)

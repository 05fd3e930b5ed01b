# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings that ``cdff log convert`` has written are opened with the names of the original log."""

from __future__ import annotations

from cdff_common.errors import CodecError
from cdff_dev.logs.formats.ros.log import RosLog
from cdff_dev.logs.formats.ros.recording import Recording
from cdff_dev.logs.restored import NAMES_TOPIC, OriginalNames, RestoredLog
from cdff_dev.logs.source import LogSource


def open_recording(recording: Recording, robot: str) -> LogSource:
    """Return a recording as a log: with its original names if it has them, else those of its topics.

    Parameters
    ----------
    recording : Recording
    robot : str
        Robot id of the streams.

    Raises
    ------
    CodecError
        If a message cannot be decoded.
    """
    log = RosLog(recording, robot)
    names = _original_names(recording)
    return log if names is None else RestoredLog(log, names)


def _original_names(recording: Recording) -> OriginalNames | None:
    channels = [c for c in recording.channels if c.topic == NAMES_TOPIC and not c.fault]
    for channel, _, raw in recording.messages(channels) if channels else ():
        try:
            return OriginalNames.from_json(recording.decode(channel, raw).data)
        except (CodecError, AttributeError):
            return None
    return None

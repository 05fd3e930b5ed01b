# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings that ``cdff log convert`` has written are opened with the names of the original log."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from cdff_common.errors import CodecError, InputError
from cdff_dev.logs.formats.ros.log import RosLog
from cdff_dev.logs.formats.ros.named_calibration import NamedCalibration
from cdff_dev.logs.formats.ros.recording import Recording
from cdff_dev.logs.restored import NAMES_TOPIC, OriginalNames, RestoredLog
from cdff_dev.logs.source import LogSource
from services.ros_messages.fixes import LocalFrame


def open_recording(recording: Recording, robot: str, calibration: Path | None = None) -> LogSource:
    """Return a recording as a log: with its original names if it has them, else those of its topics.

    Parameters
    ----------
    recording : Recording
    robot : str
        Robot id of the streams.
    calibration : Path, optional
        Calibration of the cameras, instead of those of the recording.

    Raises
    ------
    InputError
        If the calibration cannot be read, or the recording has the cameras of the original log.
    CodecError
        If a message cannot be decoded.
    """
    names = _original_names(recording)
    if names is None:
        named = None if calibration is None else NamedCalibration.read(calibration)
        return RosLog(recording, robot, calibration=named)
    if calibration is not None:
        recording.close()
        raise InputError(f"{recording.name}: a converted log with its own cameras; expected no calibration")
    try:
        local_frames = {stream: LocalFrame.from_row(row) for stream, row in names.local_frames.items()}
    except InputError:  # of a damaged file
        local_frames = {}
    return RestoredLog(RosLog(recording, robot, local_frames), names)


def _original_names(recording: Recording) -> OriginalNames | None:
    """Return the names in the last message that has them, which are all."""
    channels = [c for c in recording.channels if c.topic == NAMES_TOPIC and not c.fault]
    names = None
    for channel, _, raw in recording.messages(channels) if channels else ():
        with suppress(CodecError, AttributeError):  # of a damaged message
            names = OriginalNames.from_json(recording.decode(channel, raw).data) or names
    return names

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reading of trajectories from TUM, KITTI and CSV files and logs, which are distinguished by content."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np

from cdff_common.errors import CdffError, FrameNotFoundError, InputError
from cdff_common.formats.file_source import load
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import PoseTrajectory
from cdff_dev.compare.trajectory.track import Track
from cdff_dev.logs import open_log
from cdff_dev.logs.formats.poses.pose_files import first_numbers, pose_format, read_poses
from cdff_dev.logs.mounts import mounts
from cdff_dev.logs.source import LogSample, LogSource, only_stream

_POSES = ("PoseTrajectory", "RigidBodyState", "TransformWithCovariance")


def read_track(path: str | Path, stream: str | None = None, frame: str | None = None) -> Track:
    """Read a trajectory.

    Parameters
    ----------
    path : str or Path
        A TUM file (8 numbers per line), a KITTI pose file (12 numbers per line, rows of ``T (3, 4)``), a CSV
        file with named columns (EuRoC), or a log of any format (see ``open_log``).
    stream : str, optional
        Stream of the log; required if several streams contain poses. The last value of a stream of
        PoseTrajectory is used.
    frame : str, optional
        Frame whose poses are returned instead of those of the stream, such as that of a camera; the log
        states its place on the robot.

    Raises
    ------
    InputError
        If the file has another format, or the log has no stream of poses, or several and none is given, or
        the place of ``frame`` is not known.
    """
    if Path(path).is_file():
        source = load(path)
        if pose_format(source) is not None and frame is not None:
            raise source.error(f"a file of poses names no frames; {frame} can be chosen in a log")
        if pose_format(source) is not None:
            return Track.of_ascending(str(path), *read_poses(source))
        columns = len(first_numbers(source))
        if columns in (8, 12):
            raise source.error("the first line is no pose: its quaternion or matrix is no rotation")
        if columns:
            raise source.error(f"{columns} numbers in the first line, expected 8 (TUM) or 12 (KITTI)")
    return _from_log(path, stream, frame)


def _from_log(path: str | Path, stream: str | None, frame: str | None) -> Track:
    """Return the poses of a stream of a log, in another frame on request; raises InputError."""
    try:
        log = open_log(path)
    except CdffError as error:
        raise InputError(f"{path}: not a TUM file, KITTI pose file or log: {error}") from error
    with closing(log):
        selected = only_stream(log, _POSES, stream, "poses")
        samples = list(log.samples([selected]))
        place = None if frame is None else _place(log, samples, frame)
    values = [sample.value for sample in samples]
    name = f"{path} {selected}"
    if not values:
        raise InputError(f"{name}: the stream has no samples")
    if isinstance(values[-1], PoseTrajectory):
        trajectory: PoseTrajectory = values[-1]
        return Track(name, trajectory.stamps_ns, trajectory.matrices, trajectory.covariances)
    track = _from_poses(name, samples)
    return track if place is None else replace(track, matrices=track.matrices @ place, covariances=None)


def _place(log: LogSource, samples: list[LogSample], frame: str) -> FloatArray:
    """Return the pose ``(4, 4)`` of a frame in that of poses."""
    child_frame = getattr(samples[0].value, "child_frame", "") if samples else ""
    if child_frame == frame:
        return np.eye(4)
    try:
        return np.asarray(mounts(log).lookup(child_frame, frame, 0).matrix, np.float64)
    except FrameNotFoundError as error:
        raise InputError(
            f"--ref-frame {frame}: its place in {child_frame} is not in the log: {error}"
        ) from error


def _from_poses(name: str, samples: list[LogSample]) -> Track:
    """Return a track with one pose per stamp; of several poses with the same stamp the last is used."""
    transform_at = {_stamp_ns(sample): sample.value.transform for sample in samples}
    stamps_ns = np.array(sorted(transform_at), dtype=np.int64)
    transforms = [transform_at[int(stamp)] for stamp in stamps_ns]
    unknown = np.full((6, 6), np.nan)
    covariances = None
    if any(T.covariance is not None for T in transforms):
        covariances = np.array([unknown if T.covariance is None else T.covariance for T in transforms])
    dropped = len(samples) - len(stamps_ns)
    return Track(name, stamps_ns, np.array([T.matrix for T in transforms]), covariances, dropped)


def _stamp_ns(sample: LogSample) -> int:
    """Return the stamp of the pose in a sample, nanoseconds; without one, that of the sample."""
    return int(getattr(sample.value, "stamp_ns", sample.stamp_ns))

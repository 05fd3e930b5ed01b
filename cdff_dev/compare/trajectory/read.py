# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reading of trajectories from TUM, KITTI and CSV files and logs, which are distinguished by content."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np

from cdff_common.errors import CdffError, InputError
from cdff_common.formats.file_source import Source, load
from cdff_common.formats.tum import read_tum
from cdff_common.geometry import se3
from cdff_common.types import PoseTrajectory
from cdff_dev.compare.trajectory.csv_poses import is_pose_csv, read_pose_csv
from cdff_dev.compare.trajectory.track import Track
from cdff_dev.logs import open_log
from cdff_dev.logs.source import LogSample, only_stream

#: Assumed time between poses: KITTI pose files contain no times.
KITTI_PERIOD_NS = 100_000_000
_POSES = ("PoseTrajectory", "RigidBodyState", "TransformWithCovariance")


def read_track(path: str | Path, stream: str | None = None) -> Track:
    """Read a trajectory.

    Parameters
    ----------
    path : str or Path
        A TUM file (8 numbers per line), a KITTI pose file (12 numbers per line, rows of ``T (3, 4)``), a CSV
        file with named columns (EuRoC), or a log of any format (see ``open_log``).
    stream : str, optional
        Stream of the log; required if several streams contain poses. The last value of a stream of
        PoseTrajectory is used.

    Raises
    ------
    InputError
        If the file has another format, or the log has no stream of poses, or several and none is given.
    """
    if Path(path).is_file():
        source = load(path)
        if is_pose_csv(source):
            return Track.of_ascending(str(path), *read_pose_csv(source))
        columns = _columns(source)
        if columns == 8:
            stamps_ns, matrices = read_tum(source)
            return Track.of_ascending(str(path), stamps_ns, matrices)
        if columns == 12:
            return _kitti(source)
        if columns:
            raise source.error(f"{columns} numbers in the first line, expected 8 (TUM) or 12 (KITTI)")
    return _from_log(path, stream)


def _columns(source: Source) -> int:
    """Return the number of numbers in the first line that is not a comment; 0 if it has other words."""
    try:
        head = source.data[: 1 << 16].decode("ascii")
        for line in head.splitlines():
            words = line.split("#")[0].replace(",", " ").split()
            if words:
                [float(word) for word in words]
                return len(words)
    except ValueError:  # not text, or not numbers
        return 0
    return 0


def _kitti(source: Source) -> Track:
    try:
        table = np.loadtxt(source.data.decode().splitlines(), ndmin=2)
        if table.shape[1] != 12:
            raise ValueError(f"{table.shape[1]} numbers per line")
        if not np.isfinite(table).all():
            raise ValueError("numbers that are not finite")
    except ValueError as error:
        raise source.error(f"{error}; expected 12 numbers per line: the upper rows of a 4x4 pose") from error
    rows = table.reshape(-1, 3, 4)
    R = se3.normalise_rotation(rows[:, :, :3])
    if np.abs(R - rows[:, :, :3]).max() > 1e-2:
        raise source.error("a 3x3 block differs by more than 0.01 from a rotation")
    return Track(
        source.name, np.arange(len(rows), dtype=np.int64) * KITTI_PERIOD_NS, se3.transform(R, rows[:, :, 3])
    )


def _from_log(path: str | Path, stream: str | None) -> Track:
    try:
        log = open_log(path)
    except CdffError as error:
        raise InputError(f"{path}: not a TUM file, KITTI pose file or log: {error}") from error
    with closing(log):
        selected = only_stream(log, _POSES, stream, "poses")
        samples = list(log.samples([selected]))
    values = [sample.value for sample in samples]
    name = f"{path} {selected}"
    if not values:
        raise InputError(f"{name}: the stream has no samples")
    if isinstance(values[-1], PoseTrajectory):
        trajectory: PoseTrajectory = values[-1]
        return Track(name, trajectory.stamps_ns, trajectory.matrices, trajectory.covariances)
    return _from_poses(name, samples)


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
    """Return the time of a pose; of a state without one that of the sample."""
    return int(getattr(sample.value, "stamp_ns", sample.stamp_ns))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Trajectories from TUM files, KITTI pose files and logs, told by content."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cdff_common.errors import CdffError, InputError
from cdff_common.formats.source import Source, load
from cdff_common.formats.tum import read_tum
from cdff_common.geometry import se3
from cdff_common.types import PoseTrajectory, TransformWithCovariance
from cdff_dev.logs import open_log
from cdff_dev.trajectory.track import Track

#: KITTI pose files carry no times (contract §3).
KITTI_PERIOD_NS = 100_000_000
_POSES = ("PoseTrajectory", "TransformWithCovariance")


def read_track(path: str | Path, stream: str | None = None) -> Track:
    """Read a trajectory.

    Parameters
    ----------
    path : str or Path
        A TUM file (8 numbers a line), a KITTI pose file (12 numbers a line, rows of ``T (3, 4)``), or anything that
        ``open_log`` opens.
    stream : str, optional
        Which stream of a log; needed where more than one holds poses. Of a stream of PoseTrajectory the last is taken.

    Raises
    ------
    InputError
        If it is none of these, or the log holds no poses, or more than one stream of them and none is named.
    """
    if Path(path).is_file():
        source = load(path)
        columns = _columns(source)
        if columns == 8:
            stamps_ns, matrices = read_tum(source)
            return Track(str(path), stamps_ns, matrices)
        if columns == 12:
            return _kitti(source)
        if columns:
            raise source.error(f"{columns} numbers in the first line, expected 8 (TUM) or 12 (KITTI)")
    return _from_log(path, stream)


def _columns(source: Source) -> int:
    """How many numbers the first line holds that is no comment; 0 where it is not made of numbers."""
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
        if table.shape[1] != 12 or not np.isfinite(table).all():
            raise ValueError(f"lines of {table.shape[1]} numbers, or some that are not finite")
    except ValueError as error:
        raise source.error(f"{error}; expected 12 numbers a line: the upper rows of a 4x4 pose") from error
    rows = table.reshape(-1, 3, 4)
    R = se3.normalise_rotation(rows[:, :, :3])
    if np.abs(R - rows[:, :, :3]).max() > 1e-2:
        raise source.error("a rotation is farther than 0.01 from any")
    return Track(source.name, np.arange(len(rows), dtype=np.int64) * KITTI_PERIOD_NS, se3.transform(R, rows[:, :, 3]))


def _from_log(path: str | Path, stream: str | None) -> Track:
    try:
        log = open_log(path)
    except CdffError as error:
        raise InputError(f"{path}: no TUM file, no KITTI pose file and no log: {error}") from error
    try:
        known = [name for name, info in log.streams.items() if info.type_name in _POSES]
        chosen = [stream] if stream is not None else known
        if len(chosen) != 1 or chosen[0] not in known:
            what = f"stream {stream!r} holds no poses" if stream is not None else f"{len(known)} streams of poses"
            raise InputError(f"{path}: {what}; name one of: {', '.join(known) or 'none is there'}")
        values = [sample.value for sample in log.samples(chosen)]
    finally:
        log.close()
    name = f"{path} {chosen[0]}"
    if isinstance(values[-1], PoseTrajectory):
        last: PoseTrajectory = values[-1]
        return Track(name, last.stamps_ns, last.matrices, last.covariances)
    return _from_poses(name, values)


def _from_poses(name: str, values: list[TransformWithCovariance]) -> Track:
    """One row for each pose; those that come again with the same stamp replace the earlier ones."""
    latest = {value.stamp_ns: value.transform for value in values}
    stamps_ns = np.array(sorted(latest), dtype=np.int64)
    transforms = [latest[int(stamp)] for stamp in stamps_ns]
    unknown = np.full((6, 6), np.nan)
    covariances = None
    if any(T.covariance is not None for T in transforms):
        covariances = np.array([unknown if T.covariance is None else T.covariance for T in transforms])
    return Track(name, stamps_ns, np.array([T.matrix for T in transforms]), covariances)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reading of poses between clouds: outputs of ``cdff run``, files with one pose, trajectories, folders."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.errors import CdffError, InputError
from cdff_common.formats.pose import PoseValue, read_pose
from cdff_common.geometry import UncertainTransform
from cdff_dev.compare.trajectory.read import read_track

_REPORT = "outputs.json"


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """True or estimated pose between two clouds.

    Attributes
    ----------
    T : UncertainTransform or None
        None if there is no estimate, or no true pose.
    metrics : mapping of str to float
        Metrics of its quality, such as numbers of matches.
    """

    T: UncertainTransform | None
    metrics: Mapping[str, float] = field(default_factory=dict)


def read_pairs(path: str | Path, stream: str | None = None, port: str | None = None) -> dict[str, Pair]:
    """Return poses by the name of their pair: the entry of the folder, or the stamp of the trajectory.

    Raises
    ------
    InputError, CodecError
        If there is no such file or folder, or a file is malformed.
    """
    file = Path(path)
    report = file if file.name == _REPORT else file / _REPORT
    if report.is_file():
        return {"pair": _read_report(report, port)}
    if file.is_dir() and stream is None:
        entries = sorted(e for e in file.iterdir() if not e.name.startswith("."))
        try:
            return {
                e.stem if e.is_file() else e.name: _read_entry(e, port)
                for e in entries
                if e.is_file() or (e / _REPORT).is_file()
            }
        except CdffError:
            if any(e.suffix == ".msg" for e in entries):
                return _read_track_pairs(file, stream)
            raise
    if file.is_file() and stream is None:
        try:
            return {"pair": Pair(read_pose(file).T)}
        except CdffError:
            return _read_track_pairs(file, stream)  # the file may contain a trajectory
    if not file.exists():
        raise InputError(f"{path}: there is no such file or folder")
    return _read_track_pairs(file, stream)


def _read_entry(path: Path, port: str | None) -> Pair:
    if path.is_dir():
        return _read_report(path / _REPORT, port)
    return Pair(None) if path.stat().st_size == 0 else Pair(read_pose(path).T)


def _read_report(path: Path, port: str | None) -> Pair:
    """Return the pose of an ``outputs.json`` with the metrics of its quality."""
    try:
        report: Any = json.loads(path.read_text(encoding="utf-8"))
        poses = {n: e for n, e in report["outputs"].items() if e["type"] == "TransformWithCovariance"}
        metrics = {
            key: float(value) for key, value in report["quality"]["metrics"].items() if value is not None
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: not an output of `cdff run`: {error!r}") from error
    name = port or (next(iter(poses)) if len(poses) == 1 else None)
    if name not in poses:
        raise InputError(f"{path}: poses are {', '.join(poses) or 'none'}; name one with --port")
    value = poses[name].get("value")
    return Pair(None if value is None else PoseValue.from_json(value, str(path)).T, metrics)


def _read_track_pairs(path: Path, stream: str | None) -> dict[str, Pair]:
    track = read_track(path, stream)
    covariances = [None] * len(track) if track.covariances is None else list(track.covariances)
    return {
        str(stamp): Pair(UncertainTransform(T, None if C is None or np.isnan(C).any() else C))
        for stamp, T, C in zip(track.stamps_ns, track.matrices, covariances, strict=True)
    }

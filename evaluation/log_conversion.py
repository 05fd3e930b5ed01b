# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One recording in several formats: ``cdff slam`` and ``cdff vo`` give the result of the compound alone.

The sweeps and stereo pairs of KITTI are converted to a ROS 1 bag and two kinds of MCAP, the sweeps also to
PLY. The trajectory of each is compared with that of ``cdff replay`` on the original files.
"""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.cli import EXIT_DONE, main
from cdff_common.errors import CdffError
from cdff_common.formats.tum import read_tum
from cdff_common.geometry import se3
from cdff_dev.logs.sinks import ROS2


@dataclass(frozen=True, slots=True)
class Recording:
    """A data set, the command for it, its compound, and the formats to which it is converted."""

    folder: str
    command: str
    dfpc: str
    formats: tuple[str, ...]
    stream: str


#: Endings of the converted logs; before ``.mcap`` the schemas of an MCAP file other than those of ROS 2.
_NAMES = {
    "ply": "PLY files",
    "bag": "ROS 1 bag",
    "mcap": "MCAP",
    "foxglove.mcap": "MCAP of Foxglove's schemas in protobuf",
    "foxglove-json.mcap": "MCAP of Foxglove's schemas in JSON",
}
_BAGS = tuple(name for name in _NAMES if name != "ply")
RECORDINGS = (
    Recording("kitti_velodyne", "slam", "lidar_slam", tuple(_NAMES), "/robot/lidar.scan"),
    Recording("kitti_stereo", "vo", "visual_odometry_sparse", _BAGS, "/kitti/navcam.pair"),
)
_FILES = {
    "slam": ("trajectory.tum", "map.ply", "map.png", "trajectory.png", "report.html"),
    "vo": ("trajectory.tum", "trajectory.png", "report.html"),
}


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results of each recording and format."""
    with tempfile.TemporaryDirectory() as folder:
        return {
            recording.folder: compare_formats(recording, data / recording.folder, Path(folder), progress)
            for recording in RECORDINGS
        }


def compare_formats(
    recording: Recording, source: Path, work: Path, progress: Callable[[str], None] = lambda _: None
) -> dict[str, Any]:
    """Return the result of a recording in its own format and in each other one.

    Raises
    ------
    CdffError
        If a command fails, or a file of its result is missing.
    """
    alone = work / f"{recording.folder}_alone"
    _run("replay", str(source), "--dfpc", recording.dfpc, "--out", str(alone))
    reference = read_tum(alone / "pose.tum")
    rows = {"as recorded": _result(recording, source, work / f"{recording.folder}_path", reference)}
    for suffix in recording.formats:
        progress(f"log_conversion: {recording.folder} as {suffix}")
        target = work / f"{recording.folder}.{suffix}"
        if suffix == "ply":
            _run("log", "export", str(source), recording.stream, "--out", str(target))
        else:
            schemas = suffix.removesuffix(".mcap") if suffix.endswith(".mcap") else ROS2
            _run("log", "convert", str(source), str(target), "--schemas", schemas)
        rows[_NAMES[suffix]] = _result(recording, target, work / f"{recording.folder}_{suffix}", reference)
    return rows


def _result(recording: Recording, path: Path, out: Path, reference: tuple[Any, Any]) -> dict[str, Any]:
    run = json.loads(_run(recording.command, str(path), "--out", str(out), "--json"))
    missing = [name for name in _FILES[recording.command] if not (out / name).is_file()]
    if missing:
        raise CdffError(f"{path}: cdff {recording.command} wrote no {', '.join(missing)}")
    stamps_ns, T = read_tum(out / "trajectory.tum")
    if not np.array_equal(stamps_ns, reference[0]):
        raise CdffError(
            f"{path}: {len(stamps_ns)} poses at other times than the {len(reference[0])} expected"
        )
    E = se3.inverse(reference[1]) @ T
    E[np.all(reference[1] == T, axis=(1, 2))] = np.eye(4)  # without the rounding of the product
    truth = run["truth"] if isinstance(run["truth"], dict) else None
    return {
        "poses": run["poses"],
        "statuses": run["statuses"],
        "path_length_m": round(run["path_length_m"], 3),
        "largest_difference_m": float(np.linalg.norm(E[:, :3, 3], axis=1).max()),
        "largest_difference_deg": float(np.degrees(se3.rotation_angle(E[:, :3, :3])).max()),
        "rmse_m": None if truth is None else round(truth["ate"]["translation_m"]["rmse"], 4),
        "rmse_deg": None if truth is None else round(truth["ate"]["rotation_aligned_deg"]["rmse"], 4),
        "drift_percent": None if truth is None else round(truth["drift"]["translation_percent"], 4),
        "cpu_s": round(run["cpu_s"], 1),
    }


def _run(*arguments: str) -> str:
    """Run a command line of ``cdff`` and return its output; raises CdffError if it fails."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(list(arguments))
    if code != EXIT_DONE:
        raise CdffError(f"cdff {' '.join(arguments)} ended with {code}: {err.getvalue().strip()}")
    return out.getvalue()


def table(figures: Mapping[str, Any]) -> str:
    """Return the table of results."""
    columns = (
        "recording",
        "format",
        "command",
        "poses",
        "path, m",
        "difference from the compound alone",
    )
    columns += ("RMSE of positions and orientations, drift", "CPU, s")
    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    for recording in RECORDINGS:
        for name, row in figures[recording.folder].items():
            statuses = ", ".join(f"{n} {status}" for status, n in sorted(row["statuses"].items()))
            equal = row["largest_difference_m"] == row["largest_difference_deg"] == 0.0
            difference = f"{row['largest_difference_m']:.1e} m, {row['largest_difference_deg']:.1e}°"
            errors = "no true poses"
            if row["rmse_m"] is not None:
                errors = f"{row['rmse_m']:.4f} m, {row['rmse_deg']:.3f}°, {row['drift_percent']:.3f} %"
            cells = (
                recording.folder,
                name,
                f"`cdff {recording.command}`",
                f"{row['poses']} ({statuses})",
                f"{row['path_length_m']:.3f}",
                "none" if equal else difference,
                errors,
                f"{row['cpu_s']:.1f}",
            )
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)

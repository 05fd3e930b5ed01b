# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""True poses of a folder of images: ``truth.csv``, ``groundtruth.csv``, ``poses.csv``, or ``A_from_B.csv``.

The first line names the columns: ``image`` (name of the file) or ``frame`` (last number in that name), and
either ``T00`` to ``T23``, the upper rows of a pose, or a quaternion ``qw qx qy qz`` and a position
``tx_m ty_m tz_m`` or ``tx_km ty_km tz_km``. If the folder contains a mesh, the poses are those
of this target in the camera (``/robot/truth.target``), otherwise of the camera in the world
(``/robot/truth.pose``). Those of ``A_from_B.csv`` are poses of B in A, of which one can be ``camera``:
``camera_from_board.csv`` is ``/robot/truth.board``. Columns of other names are not converted.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cdff_common.contract.foreign_names import frame_name, name_of
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.logs.formats.images.sequences import ImageSequence, last_number
from cdff_dev.logs.image_streams import Stamps, pose_stream
from cdff_dev.logs.indexed import IndexedStream

_TABLES = ("truth.csv", "groundtruth.csv", "poses.csv")
_SEPARATOR = "_from_"
_MESHES = (".ply", ".obj", ".stl", ".wrl")
_MATRIX = [f"T{row}{col}" for row in range(3) for col in range(4)]
_QUATERNION = ["qx", "qy", "qz", "qw"]
#: Columns of a position and their unit in metres.
_POSITIONS = ((["tx_m", "ty_m", "tz_m"], 1.0), (["tx_km", "ty_km", "tz_km"], 1e3))


@dataclass(frozen=True, slots=True)
class Truth:
    """True poses of a table.

    Attributes
    ----------
    name : str
        Name of the stream.
    stream : IndexedStream
    without_image : int
        Poses without an image.
    rows : int
    other_columns : list of str
        Columns that are not part of the poses.
    """

    name: str
    stream: IndexedStream
    without_image: int
    rows: int
    other_columns: list[str]


def truth_tables(folder: Path) -> list[Path]:
    """Return the tables of true poses of a folder by their names; of several usual names only the first."""
    usual = [folder / name for name in _TABLES if (folder / name).is_file()][:1]
    return usual + sorted(folder.glob(f"*{_SEPARATOR}*.csv"))


def truth_stream(robot: str, folder: Path, path: Path, sequence: ImageSequence, stamps_ns: Stamps) -> Truth:
    """Return the true poses of a table.

    Raises
    ------
    InputError
        With file and line, if the table has other columns or content.
    """
    with path.open(encoding="utf-8", errors="replace", newline="") as file:
        rows = list(csv.DictReader(file))
    if not rows:
        raise InputError(f"{path}: expected a line of names and lines of numbers")
    key = "image" if "image" in rows[0] else "frame"
    try:
        names = [row[key] if key == "image" else int(row[key]) for row in rows]
        T = table_poses(rows)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: {type(error).__name__} {error}; expected image or frame, and T00 to T23 or qw … tz_m"
        ) from error
    index = {file.name if key == "image" else last_number(file): i for i, file in enumerate(sequence.files)}
    images = {index[name]: i for i, name in enumerate(names) if name in index}
    if not images:
        raise InputError(f"{path}: no pose of an image in {sequence.folder}: first is {key} {names[0]}")
    order = sorted(images)
    chosen = T[[images[image] for image in order]]
    name, parent, child = truth_names(robot, path, sequence.sensor)
    stream = pose_stream(name, chosen, stamps_ns[order], parent=parent, child=child)
    used_columns = {key, *(_MATRIX if "T00" in rows[0] else [*_QUATERNION, *_position(rows[0])[0]])}
    others = [column for column in rows[0] if column and column not in used_columns]
    return Truth(name, stream, len(rows) - len(images), len(rows), others)


def truth_names(robot: str, path: Path, sensor: str) -> tuple[str, str, str]:
    """Return stream, parent and child of the poses of a table of the images of a camera."""
    camera = f"{robot}/{sensor}"
    first, separator, second = path.stem.lower().partition(_SEPARATOR)
    if separator:
        parent, child = (
            camera if name in ("camera", sensor) else frame_name(robot, name) for name in (first, second)
        )
        port = "pose" if child == camera else name_of(second, "frame")
        return f"/{robot}/truth.{port}", parent, child
    if _has_mesh(path.parent):
        return f"/{robot}/truth.target", camera, f"{robot}/target"
    return f"/{robot}/truth.pose", f"{robot}/world", camera


def table_poses(rows: list[dict[str, str]]) -> FloatArray:
    """Return the poses ``(n, 4, 4)``, metres; raises KeyError or ValueError."""
    if "T00" in rows[0]:
        upper = _columns(rows, _MATRIX).reshape(-1, 3, 4)
        return se3.transform(se3.normalise_rotation(upper[:, :, :3]), upper[:, :, 3])
    columns, unit_m = _position(rows[0])
    q_xyzw = _columns(rows, _QUATERNION)
    if not np.all(np.abs(np.linalg.norm(q_xyzw, axis=1) - 1.0) < 0.01):
        raise ValueError("a quaternion whose length is not 1")
    return se3.transform_from_quaternion_xyzw(_columns(rows, columns) * unit_m, q_xyzw)


def _position(row: dict[str, str]) -> tuple[list[str], float]:
    """Return the columns of the position, and their unit in metres."""
    return next((p for p in _POSITIONS if p[0][0] in row), _POSITIONS[0])


def _columns(rows: list[dict[str, str]], names: list[str]) -> FloatArray:
    values = np.array([[float(row[name]) for name in names] for row in rows])
    if not np.isfinite(values).all():
        raise ValueError("numbers that are not finite")
    return values


def _has_mesh(folder: Path) -> bool:
    return any(file.suffix.lower() in _MESHES for pattern in ("*", "*/*") for file in folder.glob(pattern))

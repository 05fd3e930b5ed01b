# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Attitude of the camera of a folder of images: ``attitude.csv``.

The columns are ``stamp_s,qx,qy,qz,qw``: the time of an image in seconds since the UNIX epoch, and the
rotation
``T_inertial_camera``. The stream is ``/robot/{sensor}.attitude``.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_dev.logs.image_streams import pose_stream
from cdff_dev.logs.indexed import IndexedStream

COLUMNS = ("stamp_s", "qx", "qy", "qz", "qw")


def given_attitude_stream(robot: str, sensor: str, path: Path) -> tuple[str, IndexedStream]:
    """Return name and stream of the attitudes.

    Raises
    ------
    InputError
        With the file and the expectation, if the table has other columns or content.
    """
    with path.open(encoding="utf-8", errors="replace", newline="") as file:
        rows = list(csv.DictReader(file))
    try:
        table = np.array([[float(row[name]) for name in COLUMNS] for row in rows]).reshape(-1, 5)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path}: {type(error).__name__} {error}; expected the columns {','.join(COLUMNS)} with numbers"
        ) from error
    q_xyzw = table[:, 1:]
    norm = np.linalg.norm(q_xyzw, axis=1)
    if len(table) == 0 or not np.isfinite(table).all() or not (np.abs(norm - 1.0) < 0.01).all():
        raise InputError(f"{path}: expected lines of {','.join(COLUMNS)} with unit quaternions")
    stamps_ns = np.rint(table[:, 0] * 1e6).astype(np.int64) * 1000
    if not (np.diff(stamps_ns) > 0).all():
        raise InputError(f"{path}: expected ascending times")
    T = se3.transform_from_quaternion_xyzw(np.zeros((len(table), 3)), q_xyzw / norm[:, None])
    name = f"/{robot}/{sensor}.attitude"
    return name, pose_stream(name, T, stamps_ns, parent="inertial", child=f"{robot}/{sensor}")

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Inertial and satellite navigation of KITTI raw recordings: ``oxts/data/NNNNNNNNNN.txt``.

Geiger, A., Lenz, P., Stiller, C., Urtasun, R. (2013). Vision meets robotics: the KITTI dataset. IJRR 32(11).
doi:10.1177/0278364913491297
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import IMUSensors, Time, TransformWithCovariance
from cdff_dev.logs.image_streams import Stamps
from cdff_dev.logs.indexed import IndexedStream, headers

#: Columns of latitude, longitude (degrees), altitude (m); roll, pitch, yaw (rad); of the specific force
#: (m/s2) and the angular rate (rad/s) along x forward, y left, z up.
_POSITION, _ATTITUDE = slice(0, 3), slice(3, 6)
_FORCE, _RATE = slice(11, 14), slice(17, 20)
_FEWEST_COLUMNS = 25
#: Radius of the sphere of the Mercator projection by which KITTI's development kit computes positions.
_EARTH_RADIUS_M = 6_378_137.0


def imu_stream(name: str, files: list[Path], stamps_ns: Stamps, frame: str) -> IndexedStream:
    """Return the specific forces and angular rates of the files."""

    def read(i: int) -> IMUSensors:
        row = _read(files[i])
        return IMUSensors(Time.from_ns(int(stamps_ns[i])), row[_FORCE], row[_RATE], np.zeros(3))

    return IndexedStream("IMUSensors", stamps_ns, read, headers(name, stamps_ns, frame=frame))


def truth_stream(name: str, files: list[Path], stamps_ns: Stamps, parent: str, child: str) -> IndexedStream:
    """Return the poses of the navigation system in east, north, up, relative to its first position.

    The positions are those of the data set's own development kit: Mercator's projection, scaled for the first
    latitude.
    """
    first = _read(files[0])[_POSITION]
    scale = float(np.cos(np.radians(first[0])))

    def read(i: int) -> TransformWithCovariance:
        row = _read(files[i])
        position_m = _mercator_m(row[_POSITION], scale) - _mercator_m(first, scale)
        roll, pitch, yaw = row[_ATTITUDE]
        T = se3.transform(_rotation(roll, pitch, yaw), position_m)
        return TransformWithCovariance.from_transform(
            UncertainTransform(T), parent=parent, child=child, stamp_ns=int(stamps_ns[i]), producer="oxts"
        )

    header = headers(name, stamps_ns, frame=parent, child=child)
    return IndexedStream("TransformWithCovariance", stamps_ns, read, header)


def _read(path: Path) -> FloatArray:
    """Return the numbers of a file; raises InputError if they are not those of the navigation system."""
    try:
        row = np.array(path.read_text(encoding="utf-8", errors="replace").split(), np.float64)
    except ValueError as error:
        raise InputError(f"{path}: {error}; expected the numbers of oxts/dataformat.txt") from error
    if len(row) < _FEWEST_COLUMNS or not np.isfinite(row).all() or abs(row[0]) >= 90.0:
        raise InputError(
            f"{path}: {len(row)} numbers, latitude {row[0] if len(row) else 'missing'}: expected at least "
            f"{_FEWEST_COLUMNS} finite numbers, as oxts/dataformat.txt names them"
        )
    return row


def _mercator_m(position: FloatArray, scale: float) -> FloatArray:
    latitude, longitude = np.radians(position[:2])
    north = np.log(np.tan(np.pi / 4.0 + latitude / 2.0))
    return np.array([scale * _EARTH_RADIUS_M * longitude, scale * _EARTH_RADIUS_M * north, position[2]])


def _rotation(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Return the rotation from the vehicle (x forward, y left, z up) to east, north, up."""
    (sr, cr), (sp, cp), (sy, cy) = ((np.sin(a), np.cos(a)) for a in (roll, pitch, yaw))
    R_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    R_y = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
    R_z = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(R_z @ R_y @ R_x)

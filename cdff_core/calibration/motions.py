# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motions of two frames of one rigid body over the same intervals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray

#: Longest duration of an interval, seconds. An interval ends earlier after the rotation or distance below,
#: so that fast drives give several motions; both of its ends are stamps of the second trajectory.
INTERVAL_S = 2.0
#: Rotation of the base, radians, and distance, metres, below which a motion carries no information.
_LEAST_RAD, _LEAST_M = np.deg2rad(1.0), 0.05


@dataclass(frozen=True, slots=True, eq=False)
class MotionPairs:
    """Motions over n intervals: pose at the end in the frame at the start.

    Attributes
    ----------
    base, sensor : array, shape (n, 4, 4)
    end_ns : array, shape (n,)
    """

    base: FloatArray
    sensor: FloatArray
    end_ns: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.base)


def motion_pairs(
    base_ns: NDArray[np.int64],
    base: FloatArray,
    sensor_ns: NDArray[np.int64],
    sensor: FloatArray,
    interval_s: float = INTERVAL_S,
) -> MotionPairs:
    """Return the motions of two trajectories over common intervals, without intervals at rest.

    Parameters
    ----------
    base_ns, sensor_ns : array, shape (n,), (m,)
        Ascending stamps.
    base, sensor : array, shape (n, 4, 4), (m, 4, 4)
        Poses of the base and of the sensor, each in a fixed frame of its own.
    interval_s : float
        Duration of the intervals, which do not overlap.

    Raises
    ------
    InputError
        If the trajectories have fewer than two poses, or do not overlap in time.
    """
    if len(base_ns) < 2 or len(sensor_ns) < 2:
        raise InputError(f"{len(base_ns)} and {len(sensor_ns)} poses: expected at least two of each")
    inside = (sensor_ns >= base_ns[0]) & (sensor_ns <= base_ns[-1])
    stamps, poses = sensor_ns[inside], sensor[inside]
    if len(stamps) < 2:
        raise InputError("the two trajectories have no common interval of time")
    end_rows = [0]
    for k, stamp_ns in enumerate(stamps):
        if stamp_ns - stamps[end_rows[-1]] >= interval_s * 1e9:
            end_rows.append(k)
    base_poses = _interpolate_poses(base_ns, base, stamps[end_rows])
    first, second = (
        se3.inverse(base_poses[:-1]) @ base_poses[1:],
        se3.inverse(poses[end_rows[:-1]]) @ poses[end_rows[1:]],
    )
    # A motion is kept by the base's trajectory alone, so that noise of the sensor does not select.
    has_rotated = se3.rotation_angle(first[:, :3, :3]) >= _LEAST_RAD
    has_translated = np.linalg.norm(first[:, :3, 3], axis=1) >= _LEAST_M
    is_used = has_rotated | has_translated
    return MotionPairs(first[is_used], second[is_used], stamps[end_rows[1:]][is_used])


def _interpolate_poses(
    stamps_ns: NDArray[np.int64], poses: FloatArray, at_ns: NDArray[np.int64]
) -> FloatArray:
    """Return the poses ``(k, 4, 4)`` at times within the trajectory, along geodesics."""
    right = np.clip(np.searchsorted(stamps_ns, at_ns), 1, len(stamps_ns) - 1)
    left = right - 1
    fractions = (at_ns - stamps_ns[left]) / (stamps_ns[right] - stamps_ns[left])
    return np.array(
        [
            se3.interpolate_transform(poses[i], poses[j], float(f))
            for i, j, f in zip(left, right, fractions, strict=True)
        ]
    )

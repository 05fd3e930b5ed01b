# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Detection of jumps of the frame of the robot's poses, which occur when a filter uses an absolute fix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.geometry import OdometryBuffer, UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray

#: Maximum extrapolation of poses and odometry, and their retention, nanoseconds.
_EXTRAPOLATION_NS, _MEMORY_NS = 500_000_000, 60_000_000_000
#: Slip relative to a step of the odometry.
_SLIP_RATIO = 0.2
#: Speed of the odometry above which its origin has changed, and shortest interval between poses of this
#: test.
_MAX_SPEED_M_S, _MIN_INTERVAL_S = 5.0, 0.1
#: Allowed change between two steps if there is no odometry: from steering and braking, as a ratio of the
#: step, and from starting at rest, within 1 s.
_STEERING_RATIO, _STARTING_M = 0.7, 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """Step from one pose to the next."""

    distance_m: float  # distance travelled, without the jump
    jumped: bool = False
    #: (4, 4), jump of the frame as measured by odometry: a translation and a rotation about z; else None.
    T_new_old: FloatArray | None = None


class FrameJumpDetector:
    """Separates the motion of the robot from jumps of the frame of its poses.

    Jumps below ``min_jump_m`` and ``min_jump_rad`` count as drift.
    """

    def __init__(self, min_jump_m: float, min_jump_rad: float) -> None:
        self._min_jump_m, self._min_jump_rad = min_jump_m, min_jump_rad
        self._odometry = OdometryBuffer(_MEMORY_NS, _EXTRAPOLATION_NS)
        self._poses = OdometryBuffer(_MEMORY_NS, _EXTRAPOLATION_NS)
        self._previous: tuple[int, FloatArray] | None = None

    def add_odometry(self, stamp_ns: int, T_odom_base: FloatArray) -> None:
        """Add a pose in a frame that does not jump; an impossible speed means a new origin."""
        if self._odometry.stamps_ns:
            last_ns = self._odometry.stamps_ns[-1]
            last = self._odometry.pose(last_ns)
            elapsed_s = max(abs(stamp_ns - last_ns) * 1e-9, _MIN_INTERVAL_S)
            if last is not None and _distance(last.matrix, T_odom_base) > _MAX_SPEED_M_S * elapsed_s:
                self._odometry.clear()
        self._odometry.insert(stamp_ns, UncertainTransform(T_odom_base))

    def step(self, stamp_ns: int, T_map_base: FloatArray) -> Step:
        """Return the step from the previous pose to this one."""
        previous, self._previous = self._previous, (stamp_ns, T_map_base)
        step = Step(0.0) if previous is None else self._compare(*previous, stamp_ns, T_map_base)
        if step.jumped:
            self._poses.clear()
        self._poses.insert(stamp_ns, UncertainTransform(T_map_base))
        return step

    def _compare(self, start_ns: int, T_start: FloatArray, end_ns: int, T_end: FloatArray) -> Step:
        """Compare a step with the odometry or, without odometry, with the previous step."""
        distance_m = _distance(T_start, T_end)
        odometry_motion = self._odometry.motion(start_ns, end_ns)
        expected = (
            self._poses.motion(2 * start_ns - end_ns, start_ns)
            if odometry_motion is None
            else odometry_motion
        )
        if expected is None or end_ns <= start_ns:
            return Step(distance_m)
        T_expected = T_start @ expected
        expected_m = float(np.linalg.norm(expected[:3, 3]))
        error_m = _distance(T_expected, T_end)
        if odometry_motion is None:
            started_m = _STARTING_M * max(1.0, (end_ns - start_ns) * 1e-9)
            jumped = error_m > started_m + _STEERING_RATIO * expected_m
            return Step(expected_m, True) if jumped else Step(distance_m)
        error_rad = _yaw(T_end[:3, :3] @ T_expected[:3, :3].T)
        allowed_rad = self._min_jump_rad + _SLIP_RATIO * abs(_yaw(expected[:3, :3]))
        if error_m <= self._min_jump_m + _SLIP_RATIO * expected_m and abs(error_rad) <= allowed_rad:
            return Step(distance_m)
        R = se3.exp_so3(np.array([0.0, 0.0, error_rad]))
        return Step(expected_m, True, se3.transform(R, T_end[:3, 3] - R @ T_expected[:3, 3]))


def _distance(T_a: FloatArray, T_b: FloatArray) -> float:
    return float(np.linalg.norm(T_b[:3, 3] - T_a[:3, 3]))


def _yaw(R: FloatArray) -> float:
    return float(np.arctan2(R[1, 0], R[0, 0]))

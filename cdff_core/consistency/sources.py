# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion and vertical that each kind of sensor measures, in the axes of the base by its stated mount."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_core.consistency.limits import Limits
from cdff_core.consistency.motion_stream import MotionStream
from cdff_core.consistency.scan_rotation import ScanRotation, levelled_sweep
from cdff_core.consistency.vertical import Vertical

#: Interval over which specific forces are averaged, and shortest interval of sweeps that are used, seconds.
_FORCE_S, _SWEEP_S = 0.5, 0.45
#: Interval of samples after which the motion between them is unknown, seconds.
_GAP_S = 1.5
#: Specific force below which the sensor does not feel gravity, m/s².
_LEAST_FORCE_M_S2 = 0.5
_UP = np.array([0.0, 0.0, 1.0])


class Source(ABC):
    """A sensor, or a fused pose, that measures the motion of the robot.

    Parameters
    ----------
    name : str
        Sensor of the profile, or the port of a fused pose.
    R_base_sensor : ndarray, shape (3, 3)
        Stated rotation of its mount.

    Attributes
    ----------
    motion : MotionStream
    vertical : Vertical or None
    is_planar : bool
        True for wheels, which measure the motion in the plane of their contacts and define the base.
    is_fused : bool
        True for a pose that other sensors are part of.
    is_coarse : bool
        True if only tilts are precise.
    """

    is_planar = is_fused = is_coarse = False

    def __init__(self, name: str, R_base_sensor: FloatArray, *, has_translation: bool = False) -> None:
        self.name, self.R_base_sensor = name, R_base_sensor
        self.motion = MotionStream(has_translation=has_translation)
        self.vertical: Vertical | None = None
        self._previous_ns: int | None = None

    @abstractmethod
    def add(self, stamp_ns: int, value: Any) -> None:
        """Add a sample that is newer than the previous one; None is a failed one."""

    def _interval_s(self, stamp_ns: int) -> float:
        """Return the time since the previous sample, seconds; infinite at the first one."""
        previous_ns, self._previous_ns = self._previous_ns, stamp_ns
        return float("inf") if previous_ns is None else (stamp_ns - previous_ns) * 1e-9


class InertialSource(Source):
    """Gyro and accelerometer."""

    def __init__(self, name: str, R_base_sensor: FloatArray, limits: Limits) -> None:
        super().__init__(name, R_base_sensor)
        self.vertical = Vertical(limits.slope_rad)
        self._rate = np.zeros(3)
        self._force, self._force_s, self._forces = np.zeros(3), 0.0, 0

    def add(self, stamp_ns: int, value: Any) -> None:
        """Integrate the angular rate by trapezia; average the specific force."""
        if value is None or not (np.isfinite(value.gyro).all() and np.isfinite(value.acc).all()):
            return
        interval_s = self._interval_s(stamp_ns)
        is_gap = interval_s > _GAP_S
        rate = self.R_base_sensor @ value.gyro
        mean, self._rate = 0.5 * (rate + self._rate), rate
        x, y, z = (0.0, 0.0, 0.0) if is_gap else (mean * interval_s).tolist()
        self.motion.add(stamp_ns, (x, y, z, 0.0, 0.0, 0.0), interrupted=is_gap)
        self._force, self._forces = self._force + value.acc, self._forces + 1
        self._force_s += 0.0 if is_gap else interval_s
        if self._force_s < _FORCE_S:
            return
        force = self._force / self._forces
        self._force, self._force_s, self._forces = np.zeros(3), 0.0, 0
        length = float(np.linalg.norm(force))
        if self.vertical is not None and length > _LEAST_FORCE_M_S2:
            self.vertical.add(self.R_base_sensor @ force / length)


class PoseSource(Source):
    """Odometry of wheels, camera or lidar, or a fused pose."""

    def __init__(
        self, name: str, R_base_sensor: FloatArray, *, is_planar: bool = False, is_fused: bool = False
    ) -> None:
        super().__init__(name, R_base_sensor, has_translation=True)
        self.is_planar, self.is_fused = is_planar, is_fused
        self._pose: FloatArray | None = None
        self._frame = ""

    def add(self, stamp_ns: int, value: Any) -> None:
        """Add the motion since the previous pose; poses of another origin, and None, interrupt it."""
        interval_s, pose = self._interval_s(stamp_ns), self._pose
        if value is None:
            self._pose = None
            return
        T, frame = value.transform.matrix, value.parent_frame
        is_gap = pose is None or interval_s > _GAP_S or frame != self._frame
        motion = (0.0,) * 6
        if pose is not None and not is_gap:
            step = se3.inverse(pose) @ T
            R = self.R_base_sensor
            motion = (*(R @ se3.log_so3(step[:3, :3])).tolist(), *(R @ step[:3, 3]).tolist())
        self._pose, self._frame = T, frame
        self.motion.add(stamp_ns, motion, interrupted=is_gap)


class SweepSource(Source):
    """Sweeps or clouds of a lidar, in which the ground is visible."""

    is_coarse = True

    def __init__(self, name: str, R_base_sensor: FloatArray, limits: Limits) -> None:
        super().__init__(name, R_base_sensor)
        self.vertical = Vertical(limits.ground_tilt_rad)
        self._rotation = ScanRotation()
        self._R32 = R_base_sensor.astype(np.float32)

    def add(self, stamp_ns: int, value: Any) -> None:
        """Find the ground in a sweep and its rotation since the previous one."""
        if value is None or (self._previous_ns is not None and stamp_ns - self._previous_ns < _SWEEP_S * 1e9):
            return
        sweep = levelled_sweep(value.points_m @ self._R32.T, _UP)
        if sweep is None or self._interval_s(stamp_ns) > 2.0 * _GAP_S:
            self._rotation.reset()
        rotation = None if sweep is None else self._rotation.add(sweep)
        if sweep is not None and self.vertical is not None:
            self.vertical.add(sweep.plane.normal)
        motion = (0.0, 0.0, 0.0) if rotation is None else rotation.tolist()
        duration_ns = getattr(value, "t1_ns", stamp_ns) - getattr(value, "t0_ns", stamp_ns)
        self.motion.add(stamp_ns - duration_ns // 2, (*motion, 0.0, 0.0, 0.0), interrupted=rotation is None)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prediction of the camera motion between two images by wheels and gyro; it is not part of the estimate."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.errors import FrameNotFoundError, RefusedError
from cdff_common.geometry import OdometryBuffer, UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import DfpcContext
from cdff_core.dfns.gyro_integration.interface import GyroIntegrationInputs

#: Kinds of sensors with a camera whose frame the poses have.
CAMERAS = ("stereo_camera", "camera")
#: Time for which samples are kept, and maximum extrapolation of the motion by the wheels, nanoseconds.
_MEMORY_NS, _EXTRAPOLATION_NS = 10_000_000_000, 300_000_000

#: Translation (3,) and rotation (3, 3) of ``T_left1_left2``; None if no sensor measured it.
Increment = tuple[FloatArray | None, FloatArray | None]

#: Number of standard deviations within which a motion agrees with wheels and gyro.
GATE = 5.0
#: Standard deviations of the motion by wheels (constant part, slip relative to the distance) and by a gyro
#: (constant part, bias).
WHEEL_M, SLIP_RATIO, GYRO_RAD, GYRO_RAD_S = 0.02, 0.2, 0.01, 0.003


@dataclass(frozen=True, slots=True)
class MotionBounds:
    """Motion ``expected`` (4, 4) by wheels and gyro, with standard deviations of translation and rotation.

    A part that is not measured has an infinite standard deviation.
    """

    expected: FloatArray
    sigma_m: float
    sigma_rad: float

    @classmethod
    def of_increment(cls, increment: Increment, elapsed_s: float, *, by_gyro: bool) -> MotionBounds | None:
        """Return the bounds given an increment over a time in seconds; None if no sensor measured it.

        The rotation by wheels is not bounded, since slip changes it.
        """
        translation, rotation = increment
        if translation is None and rotation is None:
            return None
        sigma_m = np.inf if translation is None else WHEEL_M + SLIP_RATIO * float(np.linalg.norm(translation))
        sigma_rad = GYRO_RAD + GYRO_RAD_S * elapsed_s if by_gyro else np.inf
        expected = se3.transform(
            np.eye(3) if rotation is None else rotation, np.zeros(3) if translation is None else translation
        )
        return cls(expected, sigma_m, sigma_rad)

    def ratio(self, motion: FloatArray) -> float:
        """Return the ratio of the difference between a motion (4, 4) and the sensors to the largest
        difference within ``GATE``.
        """
        by_translation = float(np.linalg.norm(motion[:3, 3] - self.expected[:3, 3])) / self.sigma_m
        angle_rad = float(np.linalg.norm(se3.log_so3(self.expected[:3, :3].T @ motion[:3, :3])))
        return max(by_translation, angle_rad / self.sigma_rad) / GATE


class MotionPrior:
    """Wheel poses and angular rates of the last seconds, and the motion that they measure."""

    def __init__(self, gyro: Dfn[Any, Any, Any]) -> None:
        self._gyro = gyro
        self._odometry = OdometryBuffer(_MEMORY_NS, _EXTRAPOLATION_NS)
        self._rate_stamps_ns: list[int] = []
        self._rates: list[FloatArray] = []
        self._T_left_base: FloatArray | None = None
        self._R_left_imu: FloatArray | None = None

    def set_mounts(self, context: DfpcContext, T_base_left: UncertainTransform | None, stamp_ns: int) -> None:
        """Set the mounts of camera and IMU that are known; a sensor without a mount is not used."""
        frames, robot = context.frames, context.robot
        base = f"{robot}/base"
        try:
            T_base_left = T_base_left or frames.lookup(
                base, context.sensor_frame("navcam_left", *CAMERAS), stamp_ns
            )
            self._T_left_base = se3.inverse(T_base_left.matrix)
            T_base_imu = frames.lookup(base, context.sensor_frame("imu", "imu"), stamp_ns).matrix
            self._R_left_imu = self._T_left_base[:3, :3] @ T_base_imu[:3, :3]
        except FrameNotFoundError:
            return

    @property
    def T_base_left(self) -> FloatArray | None:
        """Mount (4, 4) of the left camera; None if unknown."""
        return None if self._T_left_base is None else se3.inverse(self._T_left_base)

    def add_pose(self, stamp_ns: int, T_odom_base: UncertainTransform) -> None:
        """Add a pose of the wheel odometry."""
        self._odometry.insert(stamp_ns, T_odom_base)

    def add_rate(self, stamp_ns: int, rate_rad_s: FloatArray) -> None:
        """Add an angular rate (3,) about the axes of the gyro if it is newer than the last one."""
        stamps = self._rate_stamps_ns
        if stamps and stamp_ns <= stamps[-1]:
            return
        stamps.append(stamp_ns)
        self._rates.append(rate_rad_s)
        if (
            stamps[-1] - stamps[0] > 2 * _MEMORY_NS
        ):  # in blocks, since removal from the front moves all others
            start = bisect_left(stamps, stamp_ns - _MEMORY_NS)
            del stamps[:start], self._rates[:start]

    def increment(self, start_ns: int, end_ns: int) -> Increment:
        """Return the translation from the wheels, and the rotation from the gyro or else from the wheels."""
        R = self._rotation_by_gyro(start_ns, end_ns)
        T = self._odometry.motion(start_ns, end_ns)
        if T is None or self._T_left_base is None:
            return None, R
        if R is not None:
            # The lever arm of the camera rotates by the rotation of the gyro, not by that of the wheels.
            T = T.copy()
            R_base_left = self._T_left_base[:3, :3].T
            T[:3, :3] = R_base_left @ R @ R_base_left.T
        T_left_left = self._T_left_base @ T @ se3.inverse(self._T_left_base)
        return T_left_left[:3, 3], T_left_left[:3, :3] if R is None else R

    def bounds(self, start_ns: int, end_ns: int) -> MotionBounds | None:
        """Return ``increment`` with its standard deviations; None if no sensor measured the motion."""
        by_gyro = self._rotation_by_gyro(start_ns, end_ns) is not None
        increment = self.increment(start_ns, end_ns)
        return MotionBounds.of_increment(increment, 1e-9 * (end_ns - start_ns), by_gyro=by_gyro)

    def _rotation_by_gyro(self, start_ns: int, end_ns: int) -> FloatArray | None:
        """Return ``R_left1_left2``; None if the rates leave a gap."""
        if self._R_left_imu is None or not self._rates:
            return None
        first = max(bisect_right(self._rate_stamps_ns, start_ns) - 1, 0)
        last = bisect_left(self._rate_stamps_ns, end_ns) + 1
        inputs = GyroIntegrationInputs(
            stamps_ns=np.array(self._rate_stamps_ns[first:last], np.int64),
            rates_rad_s=np.array(self._rates[first:last]),
            bias_rad_s=np.zeros(3),
            interval_ns=np.array([start_ns, end_ns], np.int64),
        )
        try:
            R = self._gyro.process(inputs).rotation
        except RefusedError:
            return None
        return np.asarray(self._R_left_imu @ R @ self._R_left_imu.T, dtype=np.float64)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Offset between the clocks of an odometry and of the IMU, estimated from the rotation that both measure.

Over windows of a second, the rotation about the vertical axis of the base by the odometry is compared with
the integral of the gyro, shifted by each offset of a grid. A scale error of the odometry and a constant rate
(gyro bias, unequal wheels) are eliminated by linear regression. The likelihood of an offset follows from the
remaining sum of squares with unknown variance; the prior is normal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_core.dfpcs.position_manager.frame_tree import RobotFrames
from cdff_core.dfpcs.position_manager.imu_buffer import ImuBuffer
from cdff_core.dfpcs.position_manager.measurement import Measurement

#: Standard deviation of an unknown offset, and step and bound of the grid, seconds.
_PRIOR_S, _STEP_S, _BOUND_S = 0.1, 0.02, 0.3
#: Length of a window, seconds; minimum number of windows of an estimate.
_WINDOW_S, _MIN_WINDOWS = 1.0, 15
#: Standard deviation of the numerical error of a rotation, rad: perfect data must not give infinite weight.
_RESOLUTION_RAD = 1e-4
#: Ratio of the difference of two offsets to its standard deviation above which stamps are corrected.
_SIGNIFICANT = 3.0
#: Difference of the rotations in a window above which the window is ignored: the odometry was reset or has
#: failed.
_MAX_DIFFERENCE_RAD = 0.5
_BOUND_NS = int(_BOUND_S * 1e9)


@dataclass(frozen=True, slots=True)
class _Angle:
    """Rotation about the vertical since the first pose of a source, rad."""

    stamp_ns: int
    angle_rad: float
    rotation: FloatArray  # (3, 3), of the body in the origin of the source


class TimeOffset:
    """Offset of the clock of one odometry: stamp plus offset is the time of the IMU."""

    def __init__(self) -> None:
        self._grid_s = np.linspace(-_BOUND_S, _BOUND_S, round(2 * _BOUND_S / _STEP_S) + 1)
        self._latest: _Angle | None = None
        self._window_start: _Angle | None = None
        self._pending: list[tuple[_Angle, _Angle]] = []
        self._windows = 0
        #: Sums over the windows: of the rotation from the odometry and of its square. The sums with the gyro
        #: follow for each offset of the grid: rotation, its square, and product of both rotations.
        self._sums = np.zeros(2)
        self._gyro_sums = np.zeros((3, len(self._grid_s)))

    def add(self, stamp_ns: int, rotation: FloatArray, imu: ImuBuffer, *, restart: bool) -> None:
        """Add the rotation (3, 3) of the body at a time; late poses are ignored."""
        previous = self._latest
        if previous is not None and stamp_ns <= previous.stamp_ns:
            return
        if restart or previous is None or stamp_ns - previous.stamp_ns > _WINDOW_S * 1e9:
            self._latest = self._window_start = _Angle(stamp_ns, 0.0, rotation)
            return
        step_rad = float(se3.log_so3(previous.rotation.T @ rotation)[2])
        self._latest = _Angle(stamp_ns, previous.angle_rad + step_rad, rotation)
        start = self._window_start
        if start is not None and stamp_ns - start.stamp_ns >= _WINDOW_S * 1e9:
            self._pending.append((start, self._latest))
            self._window_start = self._latest
        while self._pending and imu.newest_ns >= self._pending[0][1].stamp_ns + _BOUND_NS:
            self._compare(*self._pending.pop(0), imu)

    def estimate(self) -> tuple[float, float]:
        """Return the offset and its standard deviation, seconds; the prior with too few windows."""
        n = self._windows
        if n < _MIN_WINDOWS:
            return 0.0, _PRIOR_S
        odometry, odometry_2 = self._sums
        gyro, gyro_2, product = self._gyro_sums
        variance = gyro_2 - gyro**2 / n + n * _RESOLUTION_RAD**2
        covariance = product - gyro * odometry / n
        remaining = odometry_2 - odometry**2 / n + n * _RESOLUTION_RAD**2 - covariance**2 / variance
        exponent = -0.5 * (n - 3) * np.log(remaining) - 0.5 * (self._grid_s / _PRIOR_S) ** 2
        weight = np.exp(exponent - exponent.max())
        weight /= weight.sum()
        mean = float(weight @ self._grid_s)
        return mean, float(np.sqrt(weight @ (self._grid_s - mean) ** 2 + _STEP_S**2 / 12.0))

    def _compare(self, start: _Angle, end: _Angle, imu: ImuBuffer) -> None:
        """Add a window to the sums unless readings are missing or no offset explains the rotation."""
        stamps, _, rates = imu.around(start.stamp_ns - _BOUND_NS, end.stamp_ns + _BOUND_NS)
        t_s = (stamps - start.stamp_ns) * 1e-9
        length_s = (end.stamp_ns - start.stamp_ns) * 1e-9
        if len(t_s) < 2 or t_s[0] > -_BOUND_S or np.diff(t_s).max() > _BOUND_S:
            return
        steps = 0.5 * np.diff(t_s) * (rates[1:, 2] + rates[:-1, 2])
        angle = np.concatenate([[0.0], np.cumsum(steps)])
        by_gyro = np.interp(length_s + self._grid_s, t_s, angle) - np.interp(self._grid_s, t_s, angle)
        by_odometry = end.angle_rad - start.angle_rad
        if np.abs(by_gyro - by_odometry).min() > _MAX_DIFFERENCE_RAD:
            return
        self._windows += 1
        self._sums += [by_odometry, by_odometry**2]
        self._gyro_sums += [by_gyro, by_gyro**2, by_gyro * by_odometry]


class StampCorrection:
    """Shifts the stamps of the odometries by their estimated offsets, once these are significant.

    The remaining offset is part of the state of the filter. Without IMU the stamps have no other reference.
    """

    def __init__(self, imu: ImuBuffer, frames: RobotFrames) -> None:
        self._imu, self._frames = imu, frames
        self._offsets: dict[str, TimeOffset] = {}
        #: Offset in use by source, seconds.
        self.applied_s: dict[str, float] = {}

    def corrected(self, m: Measurement) -> Measurement:
        """Return a measurement at the time of the IMU; no increment crosses a change of the offset."""
        offset, applied_s = (
            self._offsets.setdefault(m.source, TimeOffset()),
            self.applied_s.get(m.source, 0.0),
        )
        mount = self._frames.mount(m.child, m.stamp_ns)[:3, :3]
        offset.add(m.stamp_ns, m.T_origin_sensor.matrix[:3, :3] @ mount.T, self._imu, restart=m.restart)
        mean_s, sigma_s = offset.estimate()
        has_changed = abs(mean_s - applied_s) > _SIGNIFICANT * sigma_s
        if has_changed:
            applied_s = self.applied_s[m.source] = mean_s
        sigma_s = sigma_s if self._imu.newest_ns >= 0 else 0.0
        # Times have a resolution of a microsecond.
        stamp_ns = m.stamp_ns + round(applied_s * 1e6) * 1000
        restart = m.restart or has_changed
        return replace(m, stamp_ns=stamp_ns, stamp_sigma_s=sigma_s, restart=restart)

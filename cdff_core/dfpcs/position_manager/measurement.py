# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measurements of the sources, and the result of processing one."""

from __future__ import annotations

from dataclasses import dataclass

from cdff_common.geometry import UncertainTransform

#: Ports whose measurements are relative to the origin of an odometry, and ports of absolute poses.
ODOMETRIES = ("odometry", "visual_odometry", "lidar_odometry")
FIXES = ("fix", "absolute_fix")
_IDENTITY = UncertainTransform.identity()


@dataclass(frozen=True, slots=True, eq=False)
class Measurement:
    """Measurement of one source at one time."""

    stamp_ns: int
    source: str  # input port; a measurement of ``imu`` is only a time at which to estimate
    T_origin_sensor: UncertainTransform = _IDENTITY
    frame: str = ""  # frame of the origin
    child: str = ""  # frame of the sensor
    scale: float = 1.0  # factor on its variances
    #: True if no increment may be formed, since the previous pose is missing or has another origin.
    restart: bool = False
    #: Standard deviation of the offset of its stamp to the clock of the IMU, seconds.
    stamp_sigma_s: float = 0.0


@dataclass(frozen=True, slots=True)
class MeasurementResult:
    """Result of a measurement: used, only cloned (the next increment starts there), or refused."""

    used: bool
    reasons: tuple[str, ...] = ()

    @property
    def is_refused(self) -> bool:
        """True if the measurement contradicted the estimate."""
        return any("_refused" in reason for reason in self.reasons)

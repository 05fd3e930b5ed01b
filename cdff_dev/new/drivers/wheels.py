# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Driver of wheels with encoders. Replace ``Device``; this one simulates a circle of 0.2 m/s."""

import math
import time
from contextlib import suppress

import numpy as np

from cdff_common.client import Sensor
from cdff_common.geometry import UncertainTransform
from cdff_common.types import TransformWithCovariance

ROBOT = "mana"
SENSOR = "wheels"
PARENT, CHILD = f"{ROBOT}/{SENSOR}", f"{ROBOT}/base"  # the pose of the base since the start of the driver
WHEEL_RADIUS_M, TRACK_WIDTH_M = 0.15, 0.7  # `cdff calibrate extrinsics` measures both from a drive
SIGMA_M_SQRT_M, SIGMA_RAD_SQRT_M = 0.02, 0.03  # random error after 1 m


class Device:
    """Simulated encoders: total angles of the left and right wheels, radians."""

    def __init__(self) -> None:
        self._left_rad = self._right_rad = 0.0

    def read(self) -> tuple[float, float]:
        """Wait for a reading; return the total angles of the left and right wheels, radians."""
        time.sleep(0.1)
        self._left_rad, self._right_rad = self._left_rad + 0.127, self._right_rad + 0.140
        return self._left_rad, self._right_rad


def main() -> None:
    """Publish the integrated odometry until Ctrl-C."""
    device, x_m, y_m, yaw_rad, path_m = Device(), 0.0, 0.0, 0.0, 0.0
    last_left, last_right = device.read()
    with (
        suppress(KeyboardInterrupt),
        Sensor(f"{SENSOR}/odometry", TransformWithCovariance, frame=PARENT, child=CHILD) as wheels,
    ):
        while True:
            left, right = device.read()
            left_m, right_m = WHEEL_RADIUS_M * (left - last_left), WHEEL_RADIUS_M * (right - last_right)
            step_m, turn_rad = (left_m + right_m) / 2, (right_m - left_m) / TRACK_WIDTH_M
            x_m += step_m * math.cos(yaw_rad + turn_rad / 2)
            y_m += step_m * math.sin(yaw_rad + turn_rad / 2)
            yaw_rad, path_m, last_left, last_right = yaw_rad + turn_rad, path_m + abs(step_m), left, right
            sigmas = [SIGMA_M_SQRT_M] * 3 + [SIGMA_RAD_SQRT_M] * 3
            pose = UncertainTransform.from_xyz_rpy_deg([x_m, y_m, 0.0], [0.0, 0.0, math.degrees(yaw_rad)])
            known = UncertainTransform(pose.matrix, path_m * np.diag(np.square(sigmas)))
            stamp_ns = wheels.now_ns()
            wheels.publish(
                TransformWithCovariance.from_transform(known, parent=PARENT, child=CHILD, stamp_ns=stamp_ns)
            )


if __name__ == "__main__":
    main()

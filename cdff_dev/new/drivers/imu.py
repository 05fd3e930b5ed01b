# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Driver of an inertial measurement unit. Replace ``Device``; this one simulates a slow circle."""

import time
from contextlib import suppress

import numpy as np

from cdff_common.client import ActiveMode, Sensor
from cdff_common.types import IMUSensors

ROBOT = "mana"
SENSOR = "imu"
FRAME = f"{ROBOT}/{SENSOR}"  # x forward, y left, z up; its mount is in the profile


class Device:
    """Simulated unit with z up on a level circle of 0.2 m/s, as of the template of wheels."""

    def __init__(self) -> None:
        self.rate_hz = 100.0
        self._random = np.random.default_rng(0)

    def set_mode(self, mode: ActiveMode) -> None:
        """Set the rate; an exception here reports the sensor as lost."""
        self.rate_hz = mode.rate_hz or self.rate_hz

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Wait for a reading; return specific force (m/s²) and angular rate (rad/s, not degrees)."""
        time.sleep(1.0 / self.rate_hz)
        noise = self._random.normal(0.0, 1.0, (2, 3))
        return [0.0, 0.0056, 9.81] + 0.02 * noise[0], [0.0, 0.0, 0.0279] + 0.001 * noise[1]


def main() -> None:
    """Publish readings until Ctrl-C."""
    device = Device()
    with (
        suppress(KeyboardInterrupt),
        Sensor(f"{SENSOR}/sample", IMUSensors, frame=FRAME, on_mode=device.set_mode, queue=100) as imu,
    ):
        while True:
            force_m_s2, rate_rad_s = device.read()
            stamp_ns = imu.now_ns()  # better: the time of the device, if its clock is synchronised
            imu.publish(IMUSensors(acc=force_m_s2, gyro=rate_rad_s), stamp_ns)


if __name__ == "__main__":
    main()

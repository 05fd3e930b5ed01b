# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Driver of a lidar. Replace ``Device`` by the interface of the device; this one simulates a level floor."""

import time
from contextlib import suppress

import numpy as np

from cdff_common.client import ActiveMode, Sensor
from cdff_common.types import LidarScan

ROBOT = "mana"
SENSOR = "lidar"
FRAME = f"{ROBOT}/{SENSOR}"  # x forward, y left, z up; its mount is in the profile
#: Simulated device: height above flat ground, and numbers of rings and columns.
HEIGHT_M, RINGS, COLUMNS = 0.85, 16, 360


class Device:
    """Simulated lidar of 16 rings, which look down, above a level floor."""

    def __init__(self) -> None:
        self.rate_hz = 10.0

    def set_mode(self, mode: ActiveMode) -> None:
        """Set the rate; an exception here reports the sensor as lost."""
        self.rate_hz = mode.rate_hz or self.rate_hz

    def read(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """Wait for a sweep; return points (n, 3), metres, times (n,), µs, rings, and its duration, ns."""
        duration_s = 1.0 / self.rate_hz
        time.sleep(duration_s)
        azimuth = np.repeat(np.linspace(0, 2 * np.pi, COLUMNS, endpoint=False), RINGS)
        elevation = np.tile(np.deg2rad(np.linspace(-45, -10, RINGS)), COLUMNS)
        range_m = HEIGHT_M / np.sin(-elevation)
        horizontal = np.cos(elevation)
        directions = [horizontal * np.cos(azimuth), horizontal * np.sin(azimuth), np.sin(elevation)]
        offsets_us = (azimuth / (2 * np.pi) * duration_s * 1e6).astype(np.uint32)
        rings = np.tile(np.arange(RINGS, dtype=np.uint16), COLUMNS)
        return (range_m * np.array(directions)).T, offsets_us, rings, int(duration_s * 1e6) * 1000


def main() -> None:
    """Publish sweeps until Ctrl-C."""
    device = Device()
    with (
        suppress(KeyboardInterrupt),
        Sensor(f"{SENSOR}/scan", LidarScan, frame=FRAME, on_mode=device.set_mode) as lidar,
    ):
        while True:
            points_m, offsets_us, rings, duration_ns = device.read()
            t1_ns = lidar.now_ns()  # better: the time of the device, if its clock is synchronised
            scan = LidarScan.from_arrays(
                points_m, offsets_us, frame=FRAME, t0_ns=t1_ns - duration_ns, t1_ns=t1_ns, ring=rings
            )
            lidar.publish(scan)


if __name__ == "__main__":
    main()

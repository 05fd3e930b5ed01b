# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Driver of a stereo camera. Replace ``Device``; this one simulates a textured wall at 4 m."""

import time
from contextlib import suppress

import numpy as np

from cdff_common.client import ActiveMode, Sensor
from cdff_common.types import FramePair

ROBOT = "mana"
SENSOR = "navcam"
FRAME = f"{ROBOT}/{SENSOR}_left"  # the left camera: x right, y down, z forward; its mount is in the profile
BASELINE_M = 0.15
# Of the rectified images, pixels: focal lengths and principal point.
CAMERA_MATRIX = [[380.0, 0.0, 319.5], [0.0, 380.0, 239.5], [0.0, 0.0, 1.0]]


class Device:
    """Simulated camera: the right image is the left one, shifted by the disparity of the distance."""

    def __init__(self, distance_m: float = 4.0) -> None:
        self.rate_hz = 5.0
        self._wall = np.random.default_rng(0).integers(0, 256, (480, 704), dtype=np.uint8)
        self._disparity_px = round(CAMERA_MATRIX[0][0] * BASELINE_M / distance_m)

    def set_mode(self, mode: ActiveMode) -> None:
        """Set the rate; an exception here reports the sensor as lost."""
        self.rate_hz = mode.rate_hz or self.rate_hz

    def read(self) -> tuple[np.ndarray, np.ndarray]:
        """Wait for a pair; return the rectified left and right image, uint8."""
        time.sleep(1.0 / self.rate_hz)
        return self._wall[:, :640].copy(), self._wall[:, self._disparity_px : 640 + self._disparity_px].copy()


def main() -> None:
    """Publish pairs until Ctrl-C."""
    device = Device()
    with (
        suppress(KeyboardInterrupt),
        Sensor(f"{SENSOR}/pair", FramePair, frame=FRAME, on_mode=device.set_mode) as camera,
    ):
        while True:
            left, right = device.read()
            pair = FramePair.from_images(
                left,
                right,
                baseline_m=BASELINE_M,
                camera_matrix=CAMERA_MATRIX,
                stamp_ns=camera.now_ns(),  # better: the middle of the exposure by the clock of the device
                sensor=FRAME,
            )
            camera.publish(pair)


if __name__ == "__main__":
    main()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Driver of joints, such as those of a mast. Replace ``Device``; this one simulates a slow pan."""

import math
import time
from contextlib import suppress

from cdff_common.client import Sensor
from cdff_common.types import Joints

ROBOT = "mana"
SENSOR = "mast"
FRAME = f"{ROBOT}/base"


class Device:
    """Simulated joints with the names of the URDF, radians (metres for a prismatic joint)."""

    def __init__(self) -> None:
        self._start_s = time.monotonic()

    def read(self) -> dict[str, float]:
        """Wait for a reading; return the positions by name."""
        time.sleep(0.1)
        return {"pan": 0.5 * math.sin(0.2 * (time.monotonic() - self._start_s)), "tilt": -0.2}


def main() -> None:
    """Publish the positions until Ctrl-C. A joint at rest needs a sample per hour only."""
    device = Device()
    with (
        suppress(KeyboardInterrupt),
        Sensor(f"{SENSOR}/joints", Joints, frame=FRAME) as joints,
    ):
        while True:
            positions = device.read()
            joints.publish(Joints.from_positions(positions, stamp_ns=joints.now_ns()))


if __name__ == "__main__":
    main()

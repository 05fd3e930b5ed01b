# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Publish positions of the joints of a rover's URDF, as the driver of a mast does after each motion.

    python examples/move_mast.py ROBOT JOINT=VALUE…          # rad or m: mana pan=0.6 tilt=-0.2

The sample is published as stream ``joints`` of sensor ``mast``. A driver stamps it with the time at which it
read the joints; this example uses the time of the rover's newest pose. See ``docs/how-to/move-joints.md``.
"""

import sys

from cdff_common.client import Client, ClockLimits, Sensor
from cdff_common.types import Joints

if len(sys.argv) < 3:
    sys.exit(__doc__)
robot = sys.argv[1]
positions = {name: float(value) for name, value in (item.split("=") for item in sys.argv[2:])}

with Client(name="mast") as client:
    pose, _ = client.call(robot, "position_manager", "get_pose", {"parent": "site", "child": f"{robot}/base"})
limits = ClockLimits(delay_s=60.0)  # the pose may be older than a reading of joints
with Sensor("mast/joints", Joints, frame=f"{robot}/base", limits=limits) as mast:
    if not mast.publish(Joints.from_positions(positions, stamp_ns=pose.stamp_ns)):
        sys.exit(f"not published: {mast.status.last_fault or f'the sensor is in mode {mast.mode.name}'}")
print(f"{robot}: {', '.join(sys.argv[2:])} at {pose.stamp_ns}")

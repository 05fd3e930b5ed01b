# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Publish positions of the joints of a rover's URDF, as the driver of a mast does after each motion.

    python examples/move_mast.py ROBOT JOINT=VALUE…          # rad or m: mana pan=0.6 tilt=-0.2

The sample is published as stream ``joints`` of sensor ``mast``. A driver stamps it with the time at which it
read the joints; this example uses the time of the rover's newest pose. See ``docs/how-to/move-joints.md``.
"""

import sys

from cdff_common.bus import Bus, Qos, keys
from cdff_common.codecs import encode, encoding_string
from cdff_common.interfaces.product import Header, product_id
from cdff_common.types import Joints, JointState, Time

if len(sys.argv) < 3:
    sys.exit(__doc__)
robot, values = sys.argv[1], dict(item.split("=") for item in sys.argv[2:])

with Bus.open(name="mast") as bus:
    query = {"parent": "site", "child": f"{robot}/base"}
    pose = bus.call(keys.dfpc_rpc(robot, "position_manager", "call/get_pose"), query)
    now_ns = int(pose.attachment["t1_ns"])
    joints = Joints(
        Time.from_ns(now_ns), tuple(values), tuple(JointState(position=float(v)) for v in values.values())
    )
    header = Header(
        id=product_id(robot, "mast", "joints", now_ns, 0, ""),
        seq=0,
        t0_ns=now_ns,
        t1_ns=now_ns,
        frame=f"{robot}/base",
        producer="mast",
    )
    bus.publish(
        keys.sensor(robot, "mast", "joints"),
        encode(joints, "uper"),
        encoding=encoding_string("Joints", "uper"),
        attachment=header.to_attachment(),
        qos=Qos.STREAM,
    )
print(f"{robot}: {', '.join(sys.argv[2:])} at {now_ns}")

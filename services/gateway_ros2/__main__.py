# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gateway to a robot with ROS 2 on Zenoh (rmw_zenoh): its sensors become samples, products become topics.

python -m services.gateway_ros2 --settings FILE [--ros-connect tcp/ROBOT:7447] [--connect tcp/127.0.0.1:7447]

With ``--ros-connect`` the identity of the bus is not shown to the robot.
"""

from __future__ import annotations

import argparse
import os
import threading
from pathlib import Path

from cdff_common.bus import Bus
from cdff_common.bus.identity import Identity
from cdff_common.extras import import_extra
from cdff_common.heartbeat import add_check
from cdff_common.process import cap_threads, run_service
from services.gateways.program import add_gateway_options, gateway_connections


def main(argv: list[str] | None = None) -> int:
    """Run until SIGTERM."""
    parser = argparse.ArgumentParser(prog="gateway_ros2", description=__doc__)
    add_gateway_options(parser)
    parser.add_argument(
        "--ros-connect",
        default=os.environ.get("CDFF_ROS_CONNECT"),
        help="endpoint of the robot's rmw_zenohd; default: CDFF_ROS_CONNECT, else the router of the bus",
    )
    parser.add_argument(
        "--ros-identity",
        default=os.environ.get("CDFF_ROS_IDENTITY"),
        help="folder with ca.crt, identity.crt and identity.key for a tls/ endpoint of the robot; "
        "default: CDFF_ROS_IDENTITY",
    )
    args = parser.parse_args(argv)
    cap_threads(1)

    def body(stop: threading.Event) -> None:
        import_extra("rosbags")
        from services.gateway_ros2.gateway import SERVICE, Gateway
        from services.gateway_ros2.settings import Ros2Settings
        from services.gateways.stream_settings import load_settings

        settings = load_settings(args.settings, Ros2Settings, args.robot)
        robot_connect = args.ros_connect or args.connect
        identity = Identity.read(Path(args.ros_identity)) if args.ros_identity else None
        with (
            gateway_connections(args.connect, SERVICE, stop) as (bus, client),
            Bus.open(
                robot_connect,
                name=f"{SERVICE} robot",
                wait_s=None,
                stop=stop,
                identity=identity,
                is_anonymous=bool(args.ros_connect),
            ) as robot_bus,
        ):
            gateway = Gateway(settings, bus, robot_bus, client)
            add_check(robot_bus.loops.problem)
            bus.declare_alive(settings.robot, SERVICE)
            gateway.run(stop)

    return run_service("gateway_ros2", body)


if __name__ == "__main__":
    raise SystemExit(main())

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gateway to a robot with ROS 2 on Zenoh (rmw_zenoh): its sensors become samples, products become topics.

python -m services.gateway_ros2 --settings FILE [--ros-connect tcp/ROBOT:7447] [--connect tcp/127.0.0.1:7447]
"""

from __future__ import annotations

import argparse
import os
import threading

from cdff_common.bus import Bus
from cdff_common.cli import add_connect_option
from cdff_common.client import Client
from cdff_common.errors import ConfigurationError
from cdff_common.extras import import_extra
from cdff_common.heartbeat import add_check
from cdff_common.process import cap_threads, run_service


def main(argv: list[str] | None = None) -> int:
    """Run until SIGTERM."""
    parser = argparse.ArgumentParser(prog="gateway_ros2", description=__doc__)
    parser.add_argument("--settings", required=True, help="YAML file of the topics that may pass")
    parser.add_argument(
        "--ros-connect",
        default=os.environ.get("CDFF_ROS_CONNECT"),
        help="endpoint of the robot's rmw_zenohd; default: CDFF_ROS_CONNECT, else the router of the bus",
    )
    parser.add_argument("--robot", help="robot that the settings must name")
    add_connect_option(parser)
    args = parser.parse_args(argv)
    cap_threads(1)

    def body(stop: threading.Event) -> None:
        import_extra("rosbags")
        from services.gateway_ros2.gateway import SERVICE, Gateway
        from services.gateway_ros2.settings import Ros2Settings
        from services.gateways.settings import load_settings

        settings = load_settings(args.settings, Ros2Settings)
        if args.robot not in (None, settings.robot):
            raise ConfigurationError(
                f"{args.settings}: robot {settings.robot!r}, expected {args.robot!r}, whose profile names it"
            )
        robot_connect = args.ros_connect or args.connect
        with (
            Bus.open(args.connect, name=SERVICE, wait_s=None, stop=stop) as bus,
            Bus.open(robot_connect, name=f"{SERVICE} robot", wait_s=None, stop=stop) as robot_bus,
            Client(args.connect, name=SERVICE) as client,
        ):
            gateway = Gateway(settings, bus, robot_bus, client)
            add_check(bus.loops.problem)
            add_check(robot_bus.loops.problem)
            bus.declare_alive(settings.robot, SERVICE)
            gateway.run(stop)

    return run_service("gateway_ros2", body)


if __name__ == "__main__":
    raise SystemExit(main())

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gateway to a robot with ROS 1: its sensors become samples, products become topics.

python -m services.gateway_ros1 --settings FILE [--master http://ROBOT:11311] [--host ADDRESS]
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
    parser = argparse.ArgumentParser(prog="gateway_ros1", description=__doc__)
    parser.add_argument("--settings", required=True, help="YAML file of the topics that may pass")
    parser.add_argument(
        "--master",
        default=os.environ.get("ROS_MASTER_URI", "http://127.0.0.1:11311"),
        help="URI of the master; default: ROS_MASTER_URI, else http://127.0.0.1:11311",
    )
    parser.add_argument(
        "--host",
        default=os.environ.get("ROS_IP", "127.0.0.1"),
        help="address of this machine for the robot, and to listen on; default: ROS_IP, else loopback",
    )
    parser.add_argument("--robot", help="robot that the settings must name")
    add_connect_option(parser)
    args = parser.parse_args(argv)
    cap_threads(1)

    def body(stop: threading.Event) -> None:
        import_extra("rosbags")
        from services.gateway_ros1.gateway import SERVICE, Gateway
        from services.gateway_ros1.settings import Ros1Settings
        from services.gateways.settings import load_settings

        settings = load_settings(args.settings, Ros1Settings)
        if args.robot not in (None, settings.robot):
            raise ConfigurationError(
                f"{args.settings}: robot {settings.robot!r}, expected {args.robot!r}, whose profile names it"
            )
        with (
            Bus.open(args.connect, name=SERVICE, wait_s=None, stop=stop) as bus,
            Client(args.connect, name=SERVICE) as client,
        ):
            gateway = Gateway(settings, bus, client, args.master, args.host)
            add_check(bus.loops.problem)
            bus.declare_alive(settings.robot, SERVICE)
            gateway.run(stop)

    return run_service("gateway_ros1", body)


if __name__ == "__main__":
    raise SystemExit(main())

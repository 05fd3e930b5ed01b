# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gateway to a robot with ROS 1: its sensors become samples, products become topics.

python -m services.gateway_ros1 --settings FILE [--master http://ROBOT:11311] [--host ADDRESS]
"""

from __future__ import annotations

import argparse
import os
import threading

from cdff_common.extras import import_extra
from cdff_common.heartbeat import add_check
from cdff_common.process import cap_threads, run_service
from services.gateways.program import add_gateway_options, gateway_connections


def parse_arguments(argv: list[str] | None = None) -> argparse.Namespace:
    """Return the options; an empty variable of the environment is as none."""
    parser = argparse.ArgumentParser(prog="gateway_ros1", description=__doc__)
    add_gateway_options(parser)
    parser.add_argument(
        "--master",
        default=os.environ.get("ROS_MASTER_URI") or "http://127.0.0.1:11311",
        help="URI of the master; default: ROS_MASTER_URI, else http://127.0.0.1:11311",
    )
    parser.add_argument(
        "--host",
        default=os.environ.get("ROS_IP") or "127.0.0.1",
        help="address of this machine for the robot, and to listen on; default: ROS_IP, else loopback",
    )
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> int:
    """Run until SIGTERM."""
    args = parse_arguments(argv)
    cap_threads(1)

    def body(stop: threading.Event) -> None:
        import_extra("rosbags")
        from services.gateway_ros1.gateway import SERVICE, Gateway
        from services.gateway_ros1.settings import Ros1Settings
        from services.gateways.stream_settings import load_settings

        settings = load_settings(args.settings, Ros1Settings, args.robot)
        with gateway_connections(args.connect, SERVICE, stop) as (bus, client):
            gateway = Gateway(settings, bus, client, args.master, args.host)
            add_check(gateway.problem)
            bus.declare_alive(settings.robot, SERVICE)
            gateway.run(stop)

    return run_service("gateway_ros1", body)


if __name__ == "__main__":
    raise SystemExit(main())

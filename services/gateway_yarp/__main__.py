# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gateway to a robot with YARP: its ports become samples, and products are sent to other ports.

python -m services.gateway_yarp --settings FILE [--names HOST[:PORT]] [--host ADDRESS]
"""

from __future__ import annotations

import argparse
import os
import threading

from cdff_common.heartbeat import add_check
from cdff_common.process import cap_threads, run_service
from services.gateways.program import add_gateway_options, address_of, gateway_connections
from services.yarp.names import DEFAULT_PORT, NameServer


def parse_arguments(argv: list[str] | None = None) -> argparse.Namespace:
    """Return the options; an empty variable of the environment is as none."""
    parser = argparse.ArgumentParser(prog="gateway_yarp", description=__doc__)
    add_gateway_options(parser)
    parser.add_argument(
        "--names",
        default=os.environ.get("CDFF_YARP_NAMES") or "127.0.0.1",
        help=f"HOST[:PORT] of the name server; default: CDFF_YARP_NAMES, else 127.0.0.1:{DEFAULT_PORT}",
    )
    parser.add_argument(
        "--host",
        default=os.environ.get("CDFF_YARP_HOST") or "127.0.0.1",
        help="address of this machine for the robot, and to listen on; default: CDFF_YARP_HOST, loopback",
    )
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> int:
    """Run until SIGTERM."""
    args = parse_arguments(argv)
    cap_threads(1)

    def body(stop: threading.Event) -> None:
        from services.gateway_yarp.gateway import SERVICE, Gateway
        from services.gateway_yarp.settings import YarpSettings
        from services.gateways.stream_settings import load_settings

        settings = load_settings(args.settings, YarpSettings, args.robot)
        with gateway_connections(args.connect, SERVICE, stop) as (bus, _):
            names = NameServer(*address_of(args.names, DEFAULT_PORT), settings.node)
            gateway = Gateway(settings, bus, names, args.host)
            add_check(gateway.problem)
            bus.declare_alive(settings.robot, SERVICE)
            gateway.run(stop)

    return run_service("gateway_yarp", body)


if __name__ == "__main__":
    raise SystemExit(main())

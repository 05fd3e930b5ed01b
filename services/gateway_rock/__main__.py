# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gateway to a robot with ROCK: ports of its tasks become samples, products are written to other ports.

python -m services.gateway_rock --settings FILE [--names HOST[:PORT]]
"""

from __future__ import annotations

import argparse
import os
import threading

from cdff_common.heartbeat import add_check
from cdff_common.process import cap_threads, run_service
from services.corba.naming import DEFAULT_PORT
from services.gateways.program import add_gateway_options, address_of, gateway_connections


def parse_arguments(argv: list[str] | None = None) -> argparse.Namespace:
    """Return the options; an empty variable of the environment is as none."""
    parser = argparse.ArgumentParser(prog="gateway_rock", description=__doc__)
    add_gateway_options(parser)
    parser.add_argument(
        "--names",
        default=os.environ.get("CDFF_ROCK_NAMES") or "127.0.0.1",
        help=f"HOST[:PORT] of the name service; default: CDFF_ROCK_NAMES, else 127.0.0.1:{DEFAULT_PORT}",
    )
    parser.add_argument(
        "--host",
        default=os.environ.get("CDFF_ROCK_HOST") or "127.0.0.1",
        help="address of this machine by which the robot reaches the task for requests, the only one that is "
        "listened on; default: CDFF_ROCK_HOST, else 127.0.0.1",
    )
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> int:
    """Run until SIGTERM."""
    args = parse_arguments(argv)
    cap_threads(1)

    def body(stop: threading.Event) -> None:
        from services.gateway_rock.gateway import SERVICE, Gateway
        from services.gateway_rock.settings import RockSettings
        from services.gateways.stream_settings import load_settings

        settings = load_settings(args.settings, RockSettings, args.robot)
        with gateway_connections(args.connect, SERVICE, stop) as (bus, client):
            address = address_of(args.names, DEFAULT_PORT)
            gateway = Gateway(settings, bus, client, *address, args.host)
            add_check(gateway.problem)
            bus.declare_alive(settings.robot, SERVICE)
            gateway.run(stop)

    return run_service("gateway_rock", body)


if __name__ == "__main__":
    raise SystemExit(main())

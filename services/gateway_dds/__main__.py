# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gateway to a robot with ROS 2 on DDS: its sensors become samples, products become topics.

python -m services.gateway_dds --settings FILE [--connect tcp/127.0.0.1:7447]
"""

from __future__ import annotations

import argparse
import threading

from cdff_common.extras import import_extra
from cdff_common.heartbeat import add_check
from cdff_common.process import cap_threads, run_service
from services.gateways.program import add_gateway_options, gateway_connections


def main(argv: list[str] | None = None) -> int:
    """Run until SIGTERM."""
    parser = argparse.ArgumentParser(prog="gateway_dds", description=__doc__)
    add_gateway_options(parser)
    args = parser.parse_args(argv)
    cap_threads(1)

    def body(stop: threading.Event) -> None:
        import_extra("rosbags")
        import_extra("cyclonedds")
        from services.gateway_dds.gateway import SERVICE, Gateway
        from services.gateway_dds.settings import DdsSettings
        from services.gateways.stream_settings import load_settings

        settings = load_settings(args.settings, DdsSettings, args.robot)
        with gateway_connections(args.connect, SERVICE, stop) as (bus, client):
            gateway = Gateway(settings, bus, client)
            add_check(gateway.node.problem)
            bus.declare_alive(settings.robot, SERVICE)
            gateway.run(stop)

    return run_service("gateway_dds", body)


if __name__ == "__main__":
    raise SystemExit(main())

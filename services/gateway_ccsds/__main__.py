# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gateway to a ground segment: it sends products as files over CFDP; telemetry and commands are PUS packets.

python -m services.gateway_ccsds --settings FILE [--connect tcp/127.0.0.1:7447]
"""

from __future__ import annotations

import argparse
import threading
from pathlib import Path

from cdff_common.extras import import_extra
from cdff_common.heartbeat import add_check
from cdff_common.process import cap_threads, data_dir_of, run_service
from services.gateways.program import add_gateway_options, gateway_connections


def main(argv: list[str] | None = None) -> int:
    """Run until SIGTERM."""
    parser = argparse.ArgumentParser(prog="gateway_ccsds", description=__doc__)
    add_gateway_options(parser)
    parser.add_argument(
        "--data-dir", default=None, help="folder of the state of the gateway; default: CDFF_DATA_DIR"
    )
    args = parser.parse_args(argv)
    cap_threads(1)

    def body(stop: threading.Event) -> None:
        import_extra("spacepackets")
        import_extra("cfdppy")
        from services.gateway_ccsds.gateway import SERVICE, Gateway
        from services.gateway_ccsds.settings import CcsdsSettings
        from services.gateways.stream_settings import load_settings

        settings = load_settings(args.settings, CcsdsSettings, args.robot)
        folder = Path(args.settings).resolve().parent
        with gateway_connections(args.connect, SERVICE, stop) as (bus, client):
            gateway = Gateway(settings, folder, data_dir_of(args.data_dir), bus, client)
            add_check(gateway.problem)
            bus.declare_alive(settings.robot, SERVICE)
            gateway.run(stop)

    return run_service("gateway_ccsds", body)


if __name__ == "__main__":
    raise SystemExit(main())

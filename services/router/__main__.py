# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Zenoh router of one robot: a Python process in router mode, listening on loopback by default.

python -m services.router [--listen tcp/127.0.0.1:7447] [--scope mana --uplink tcp/GROUND:7447]
"""

from __future__ import annotations

import argparse
import logging
import os
import threading

from cdff_common.bus import Bus
from cdff_common.bus.keys import GROUND
from cdff_common.bus.session import DEFAULT_ENDPOINT
from cdff_common.process import run_service

logger = logging.getLogger(__name__)


def main(argv: list[str] | None = None) -> int:
    """Route until SIGTERM."""
    parser = argparse.ArgumentParser(prog="router", description=__doc__)
    parser.add_argument("--listen", default=os.environ.get("CDFF_LISTEN", DEFAULT_ENDPOINT))
    parser.add_argument("--uplink", help="router to link to when in contact; default: none")
    parser.add_argument("--scope", default=GROUND, help="robot of this router; default: ground")
    args = parser.parse_args(argv)

    def body(stop: threading.Event) -> None:
        with Bus.open_router(args.listen, uplink=args.uplink) as bus:
            bus.declare_alive(args.scope, "router")
            logger.info("routing on %s%s", args.listen, f", linked to {args.uplink}" if args.uplink else "")
            stop.wait()

    return run_service("router", body)


if __name__ == "__main__":
    raise SystemExit(main())

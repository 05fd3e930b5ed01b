# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The Zenoh router of one robot: a Python process in router mode, listening on loopback unless told otherwise.

python -m services.router [--listen tcp/127.0.0.1:7447]
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
    args = parser.parse_args(argv)

    def body(stop: threading.Event) -> None:
        with Bus.open_router(args.listen) as bus:
            bus.declare_alive(GROUND, "router")
            logger.info("routing on %s", args.listen)
            stop.wait()

    return run_service("router", body)


if __name__ == "__main__":
    raise SystemExit(main())

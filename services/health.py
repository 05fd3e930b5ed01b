# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Health check of containers by the liveliness tokens of their services.

python -m services.health ground/dpm mana/visual_odometry_sparse
"""

from __future__ import annotations

import argparse
import sys

from cdff_common.bus import Bus, keys
from cdff_common.errors import CdffError


def missing_services(bus: Bus, services: list[str]) -> list[str]:
    """Return the services ``scope/service`` without a token; raises InputError on a malformed name."""
    return [s for s in services if not bus.alive(keys.alive(*(s.split("/", 1) if "/" in s else ("", s))))]


def main(argv: list[str] | None = None) -> int:
    """Exit 0 if all services are alive, otherwise 1 with the names of the missing ones."""
    parser = argparse.ArgumentParser(prog="health", description=__doc__)
    parser.add_argument("services", nargs="+", metavar="SCOPE/SERVICE")
    parser.add_argument(
        "--wait-s",
        type=float,
        default=2.0,
        help="timeout for the connection to the router in seconds (default 2)",
    )
    args = parser.parse_args(argv)
    try:
        with Bus.open(name="health", wait_s=args.wait_s) as bus:
            absent = missing_services(bus, args.services)
    except CdffError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    if absent:
        sys.stderr.write(f"not alive: {', '.join(absent)}\n")
    return 1 if absent else 0


if __name__ == "__main__":
    raise SystemExit(main())

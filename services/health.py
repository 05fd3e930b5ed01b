# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Health check of containers: liveliness tokens of their services, and answers of those that hang.

python -m services.health ground/dpm mana/visual_odometry_sparse

With ``--without-router`` a router that does not answer is no failure: Kubernetes, which restarts services by
this check, would otherwise restart all of them when the router ends.
"""

from __future__ import annotations

import argparse
import sys

from cdff_common.bus import Bus, keys
from cdff_common.errors import CdffError, UnavailableError

#: Services without a status call; the supervisor, or the restart policy of the container, replaces them.
_WITHOUT_STATUS = ("router", "supervisor", "icu", "map_merging")
_CALL_S = 2.0


def missing_services(bus: Bus, services: list[str]) -> list[str]:
    """Return the services ``scope/service`` without a token; raises InputError on a malformed name."""
    return [s for s in services if not bus.alive(keys.alive(*(s.split("/", 1) if "/" in s else ("", s))))]


def _status_key(scope: str, name: str) -> str:
    if name == "orchestrator":
        return keys.orchestrator_rpc(scope, "stat")
    if name.startswith("gateway_"):
        return keys.gateway_status(scope, name)
    return keys.dpm_rpc(scope, "stat") if name == "dpm" else keys.dfpc_rpc(scope, name, "status")


def unhealthy_services(bus: Bus, services: list[str]) -> list[str]:
    """Return why DPM, orchestrators and DFPCs with a token do not work: a hung process keeps its token."""
    problems = []
    for service in services:
        scope, name = service.split("/", 1)
        if name in _WITHOUT_STATUS:
            continue
        key = _status_key(scope, name)
        try:
            body = bus.call(key, timeout_s=_CALL_S).body()
        except CdffError as error:
            problems.append(f"{service} does not answer: {error}")
            continue
        problems += [f"{service}: {x['problem']}" for x in body.get("loops", {}).values() if x["problem"]]
    return problems


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
    parser.add_argument(
        "--without-router", action="store_true", help="exit 0 if the router does not answer, not 1"
    )
    args = parser.parse_args(argv)
    try:
        bus = Bus.open(name="health", wait_s=args.wait_s)
    except CdffError as error:
        sys.stderr.write(f"{error}\n")
        return 0 if args.without_router and isinstance(error, UnavailableError) else 1
    try:
        with bus:
            absent = missing_services(bus, args.services)
            problems = [] if absent else unhealthy_services(bus, args.services)
    except CdffError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    if absent:
        sys.stderr.write(f"not alive: {', '.join(absent)}\n")
    for problem in problems:
        sys.stderr.write(f"{problem}\n")
    return 1 if absent or problems else 0


if __name__ == "__main__":
    raise SystemExit(main())

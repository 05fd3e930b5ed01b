# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Zenoh router of one robot: a Python process in router mode, listening on loopback by default.

python -m services.router [--listen tcp/127.0.0.1:7447] [--scope mana --uplink tcp/GROUND:7447]

With ``CDFF_IDENTITY`` it accepts TLS links of known identities only, and what their grants allow. When the
access-control list in the folder changes, all links are closed and opened again under the new list.
"""

from __future__ import annotations

import argparse
import logging
import os
import threading
from dataclasses import asdict
from pathlib import Path

from cdff_common.bus import Bus, keys
from cdff_common.bus.identity import ACCESS, EXPIRY, VARIABLE, Identity
from cdff_common.bus.keys import GROUND
from cdff_common.bus.session import DEFAULT_ENDPOINT, SECURE_ENDPOINT, check_access_control
from cdff_common.clock import monotonic_s
from cdff_common.errors import ConfigurationError, UnavailableError
from cdff_common.heartbeat import add_check
from cdff_common.loops import Loops
from cdff_common.process import run_service
from services.alarm_reporter import AlarmReporter
from services.alarms import Alarms
from services.router.expiry import check_expiry
from services.router.refusals import REPORT_S, RefusalMonitor, Refused

logger = logging.getLogger(__name__)

_EXPIRY_CHECK_S = 3600.0
#: Longest duration of one cycle of a thread, seconds.
_BUSY_LIMIT_S = 60.0


def main(argv: list[str] | None = None) -> int:
    """Route until SIGTERM."""
    secured = bool(os.environ.get(VARIABLE))
    default = SECURE_ENDPOINT if secured else DEFAULT_ENDPOINT
    parser = argparse.ArgumentParser(prog="router", description=__doc__)
    parser.add_argument("--listen", default=os.environ.get("CDFF_LISTEN", default))
    parser.add_argument("--uplink", help="router to link to when in contact; default: none")
    parser.add_argument("--scope", default=GROUND, help="robot of this router; default: ground")
    args = parser.parse_args(argv)
    run = _route_secured if secured else _route
    return run_service("router", lambda stop: run(args, stop))


def _route(args: argparse.Namespace, stop: threading.Event) -> None:
    with Bus.open_router(args.listen, uplink=args.uplink) as bus:
        bus.declare_alive(args.scope, "router")
        logger.info("routing on %s%s", args.listen, f", linked to {args.uplink}" if args.uplink else "")
        stop.wait()


def _route_secured(args: argparse.Namespace, stop: threading.Event) -> None:
    """Route, report refusals, and open the session again when the access-control list changes."""
    identity = Identity.of_environment()
    assert identity is not None
    path = identity.folder / ACCESS
    reporter, alarms, loops = _Reporter(args.scope), Alarms(), Loops()
    monitor = RefusalMonitor(reporter.report, alarms, loops.add("refusals", _BUSY_LIMIT_S))
    monitor.watch_log()
    reports, published = loops.add("reports", _BUSY_LIMIT_S), loops.add("alarms", _BUSY_LIMIT_S)
    add_check(loops.problem)
    while not stop.is_set():
        version = _version_of(path)
        with _open(args, stop) as bus:
            bus.declare_alive(args.scope, "router")
            reporter.bus = bus
            alarm_reporter = AlarmReporter(bus, args.scope, "router", alarms, published)
            logger.info("routing on %s with %s", args.listen, path)
            expiry, access = _Expiry(identity.folder / EXPIRY, alarms), _AccessList(identity, version)

            def wait(access: _AccessList = access) -> bool | None:
                return None if stop.wait(REPORT_S) or access.has_changed() else True

            def work(_: bool, expiry: _Expiry = expiry) -> None:
                monitor.report()
                expiry.check()

            reports.run(wait, work)
            reporter.bus = None
            alarm_reporter.close()


def _open(args: argparse.Namespace, stop: threading.Event) -> Bus:
    """Return an open router; the port can be in use for a moment after the last session."""
    for _ in range(20):
        try:
            return Bus.open_router(args.listen, uplink=args.uplink)
        except UnavailableError:
            if stop.wait(0.1):
                break
    return Bus.open_router(args.listen, uplink=args.uplink)


def _version_of(path: Path) -> tuple[int, int]:
    """Return modification time and inode of a file, which change when it is replaced."""
    try:
        status = path.stat()
    except FileNotFoundError:  # while it is being replaced
        return 0, 0
    return status.st_mtime_ns, status.st_ino


class _Expiry:
    """Periodic check of the certificates of all identities."""

    def __init__(self, path: Path, alarms: Alarms) -> None:
        self._path, self._alarms = path, alarms
        self._checked_s = -_EXPIRY_CHECK_S

    def check(self) -> None:
        """Check the certificates if the interval between checks has passed."""
        if monotonic_s() - self._checked_s >= _EXPIRY_CHECK_S:
            self._checked_s = monotonic_s()
            check_expiry(self._path, self._alarms)


class _AccessList:
    """Access-control list of the open session; it stays valid while no other can be read."""

    def __init__(self, identity: Identity, version: tuple[int, int]) -> None:
        self._identity, self._version = identity, version

    def has_changed(self) -> bool:
        """Return whether there is another list that can be read."""
        version = _version_of(self._identity.folder / ACCESS)
        if version == self._version:
            return False
        try:
            check_access_control(self._identity)
        except ConfigurationError as error:
            self._version = version  # reported once
            logger.error("%s; the last access-control list stays valid", error)
            return False
        return True


class _Reporter:
    """Publishes refusals while the router is open, and logs them."""

    def __init__(self, scope: str) -> None:
        self.bus: Bus | None = None
        self._scope = scope

    def report(self, refused: Refused, count: int) -> None:
        """Publish the event ``refused``, which the DPM enters in its history."""
        body = asdict(refused) | {"count": count, "by": refused.identity or "unknown", "source": "router"}
        logger.warning("refused %d times: %s %s of %s", count, refused.operation, refused.key, body["by"])
        if self.bus is not None:
            self.bus.publish_map(keys.event(self._scope, "refused"), body)


if __name__ == "__main__":
    raise SystemExit(main())

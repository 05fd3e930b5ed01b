# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The DPM process: ``python -m services.dpm --data-dir DIR --http 127.0.0.1:8080 [--profile FILE]``.

If the store is on a server (``--store``), the process waits while another process maintains the store. A
worker (``--worker N``) only answers calls.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager

from cdff_common import tracing
from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.errors import UnavailableError
from cdff_common.heartbeat import add_check
from cdff_common.interfaces.profile import Exchange, Profile, load_profile
from cdff_common.mission_clock import MissionClock
from cdff_common.process import run_service
from dpm_store import Store, open_store
from dpm_store.engine.disk_space import RESERVE_BYTES
from services.alarm_reporter import AlarmReporter
from services.dpm.bus.joined_robots import JoinedRobots, enter_profile
from services.dpm.bus.recorder import Recorder, rules_of_history
from services.dpm.bus.retention import rules_of
from services.dpm.bus.service import serve, served_robots
from services.dpm.bus.service_monitor import ServiceMonitor
from services.dpm.operations.condition_monitor import ConditionMonitor
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings, parse_settings
from services.dpm.worker import run_worker
from services.memory_budget import memory_budget_mb, memory_check
from services.robot_roster import RobotRoster

logger = logging.getLogger(__name__)


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve until SIGTERM."""
    return run_service("dpm", lambda stop: run(arguments, stop))


def run(arguments: Sequence[str] | None, stop: threading.Event) -> None:
    """Serve HTTP and the bus until stopped, as the DPM or as one of its workers."""
    settings = parse_settings(arguments)
    for noisy in ("alembic", "uvicorn", "uvicorn.error"):
        logging.getLogger(noisy).setLevel(logging.WARNING)
    if settings.worker:
        run_worker(settings, stop)
    else:
        run_dpm(settings, stop)


def run_dpm(settings: Settings, stop: threading.Event) -> None:
    """Open the store, wait for its lease and for the router, serve and maintain it until stopped."""
    from services.dpm.http.context import Context
    from services.dpm.http.server import HttpServer

    profile = load_profile(settings.profile) if settings.profile is not None else None
    clock = MissionClock()
    with (
        open_store(settings.store_url, clock, reserve_bytes=RESERVE_BYTES, new=settings.new) as store,
        closing(store.watch(takes_lease=True)) as watch,
        Bus.open(settings.connect, name="dpm", wait_s=None, stop=stop) as bus,  # closed before the store
    ):
        if not watch.wait_for_lease(stop):
            return
        bus.synchronise(clock)
        dpm = Dpm(store, settings.max_body_bytes)
        watch.on_commit = dpm.events.publish
        dpm.events.listen(dpm.alarm_board.follow)
        add_check(watch.problem)
        add_check(lambda: "; ".join(filter(None, (dpm.loops.problem(), bus.loops.problem()))))
        check = memory_check(dpm.alarms, "dpm", memory_budget_mb())
        reporter = AlarmReporter(bus, keys.GROUND, "dpm", dpm.alarms, dpm.loops.add("alarms"), (check,))
        if profile is not None:
            enter_profile(dpm, profile)
        monitor = ServiceMonitor(bus, dpm, () if profile is None else profile.robots)
        dpm.reports.add("overview", monitor.overview)
        dpm.reports.add("process", lambda: settings.service)
        with HttpServer(Context(dpm, settings, bus, monitor, profile)) as http:
            dpm.loops.add_check(http.problem)
            rules = rules_of(profile) + rules_of_history(profile)
            # The recorder subscribes first: samples that follow the liveliness token of the DPM are recorded.
            recorder = None if profile is None else Recorder(bus, dpm, profile)
            serve_scope = serve(bus, dpm, served_robots(profile, store), rules)
            roster = None
            if profile is not None and recorder is not None:
                joined = JoinedRobots(bus, dpm, profile, monitor, recorder, serve_scope)
                roster = RobotRoster(bus, profile, joined, dpm.loops, joined.refuse)
                roster.start()
            logger.info("serving", extra=_addresses(settings, store))
            warming = threading.Thread(target=_warm, name="warm", daemon=True)
            warming.start()
            conditions = ConditionMonitor(dpm, () if recorder is None else (recorder.store_waiting,))
            with _exchange(bus, dpm, settings, profile):
                stop.wait()
            if roster is not None:
                roster.close()
            conditions.close()
        reporter.close()
        bus.close()
        if recorder is not None:
            recorder.flush()
    if warming.is_alive():  # a compiler cannot be interrupted
        tracing.stop()
        logging.shutdown()
        os._exit(0)


@contextmanager
def _exchange(bus: Bus, dpm: Dpm, settings: Settings, profile: Profile | None) -> Iterator[None]:
    """Exchange products over a link with contact windows inside the block, if there is a contact plan."""
    refusal = ""
    if settings.contact_plan is None:
        refusal = "this DPM has no contact plan; start it with `cdff service dpm --contact-plan FILE`"
    elif settings.contact_robot is not None:
        refusal = f"this is the DPM on {settings.contact_robot}; connect to the router of the ground"
    if refusal:
        bus.serve(keys.dpm_rpc(keys.GROUND, "contact"), _refusal(refusal), workers=1)
    if settings.contact_plan is None:
        yield
        return
    from services.contact.service import start_exchange

    order = Exchange() if profile is None else profile.exchange
    link = (settings.contact_plan, settings.contact_link, settings.contact_robot)
    with closing(start_exchange(bus, dpm, *link, order)):
        yield


def _refusal(text: str) -> Callable[[Request], Reply]:
    """Return a handler of calls that raises UnavailableError with a text."""

    def refuse(_: Request) -> Reply:
        raise UnavailableError(text)

    return refuse


def _warm() -> None:
    """Load the codecs before the first product arrives."""
    from cdff_common.codecs.warm import warm_wire

    warm_wire()


def _addresses(settings: Settings, store: Store) -> dict[str, object]:
    return {"http": f"{settings.host}:{settings.port}", "data_dir": str(store.directory)}


if __name__ == "__main__":
    raise SystemExit(main())

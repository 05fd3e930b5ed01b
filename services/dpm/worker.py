# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A worker of the DPM: a further process that answers the calls of a store on a server.

Any worker answers any call, over Zenoh and on the HTTP address of the DPM. The DPM itself maintains the
store: it records samples and the history of other services, retires products, and publishes the events of
all processes on the bus.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from contextlib import closing

from cdff_common.bus import Bus, keys
from cdff_common.heartbeat import add_check
from cdff_common.interfaces.profile import load_profile
from cdff_common.interfaces.robot_profile import RobotProfile
from cdff_common.mission_clock import MissionClock
from dpm_store import open_store
from services.alarm_reporter import AlarmReporter
from services.dpm.bus.recorder import rules_of_history
from services.dpm.bus.retention import rules_of
from services.dpm.bus.service import serve, served_robots
from services.dpm.bus.service_monitor import ServiceMonitor
from services.dpm.operations.condition_monitor import ConditionMonitor
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings
from services.memory_budget import memory_budget_mb, memory_check
from services.robot_roster import RobotRoster

logger = logging.getLogger(__name__)


def run_worker(settings: Settings, stop: threading.Event) -> None:
    """Open the store, wait for the router, and answer calls until stopped."""
    from services.dpm.http.context import Context
    from services.dpm.http.server import HttpServer

    profile = load_profile(settings.profile) if settings.profile is not None else None
    clock, name = MissionClock(), settings.service
    with (
        open_store(settings.store_url, clock) as store,
        closing(store.watch()) as watch,
        Bus.open(settings.connect, name=name, wait_s=None, stop=stop) as bus,  # closed before the store
    ):
        bus.synchronise(clock)
        dpm = Dpm(store, settings.max_body_bytes)
        watch.on_commit = dpm.events.publish
        dpm.events.listen(dpm.alarm_board.follow)
        add_check(watch.problem)
        add_check(lambda: "; ".join(filter(None, (dpm.loops.problem(), bus.loops.problem()))))
        check = memory_check(dpm.alarms, name, memory_budget_mb())
        reporter = AlarmReporter(bus, keys.GROUND, name, dpm.alarms, dpm.loops.add("alarms"), (check,))
        monitor = ServiceMonitor(bus, dpm, () if profile is None else profile.robots, service=name)
        dpm.reports.add("overview", monitor.overview)
        dpm.reports.add("process", lambda: name)
        with HttpServer(Context(dpm, settings, bus, monitor, profile)) as http:
            dpm.loops.add_check(http.problem)
            rules = rules_of(profile) + rules_of_history(profile)
            serve_scope = serve(bus, dpm, served_robots(profile, store), rules, worker=name)
            roster = None
            if profile is not None:
                roster = RobotRoster(bus, profile, _ServedRobots(monitor, serve_scope), dpm.loops)
                roster.start()
            conditions = ConditionMonitor(dpm)
            logger.info("serving", extra={"http": f"{settings.host}:{settings.port}"})
            stop.wait()
            conditions.close()
            if roster is not None:
                roster.close()
        reporter.close()
        bus.close()


class _ServedRobots:
    """Robots that join: their calls are answered; the DPM itself enters them in the store."""

    def __init__(self, monitor: ServiceMonitor, serve_scope: Callable[[str], None]) -> None:
        self._monitor, self._serve_scope = monitor, serve_scope

    def set_robot(self, joined: RobotProfile) -> None:
        self._monitor.set_robot(joined.robot, joined.revision)
        self._serve_scope(joined.robot.id)

    def remove_robot(self, robot: str) -> None:
        self._monitor.remove_robot(robot)

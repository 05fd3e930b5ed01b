# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A process that hosts DFPCs: endpoints, heartbeat, watchdog."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Sequence
from functools import partial

import psutil  # type: ignore[import-untyped]

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.clock import monotonic_s
from cdff_common.codecs import encode_payload
from cdff_common.interfaces.profile import DfpcEntry, Robot
from cdff_common.loops import Loops
from services.alarm_reporter import AlarmReporter
from services.alarms import Alarms
from services.dfpc_host.calibration_alarms import set_calibration_alarm
from services.dfpc_host.hosted_dfpc import HostedDfpc
from services.dfpc_host.lifecycle import serve_life_cycle
from services.dfpc_host.outbox import Outbox
from services.dfpc_host.outbox_alarms import set_outbox_alarms
from services.dfpc_host.sensor_alarms import SensorAlarms
from services.dfpc_host.spool import Spool, capacity_bytes, spool_folder
from services.dfpc_host.watchdog import StepWatchdog
from services.memory_budget import memory_budget_mb, memory_check
from services.signing import Sign

logger = logging.getLogger(__name__)

HEARTBEAT_S = 1.0
_WATCH_S = 0.2
#: Longest wait of an operation or store query for the running step, seconds.
BUSY_S = 4.0
#: Exit code of a process ended by its watchdog; the supervisor restarts it.
EXIT_HUNG = 75


class DfpcHost:
    """Host of the DFPCs of one process."""

    def __init__(
        self, bus: Bus, entries: Sequence[tuple[Robot, DfpcEntry]], sign: Sign | None = None
    ) -> None:
        self._bus = bus
        owners = [(robot.id, entry.name) for robot, entry in entries]
        self._loops = Loops()
        spool = Spool(spool_folder(), owners, capacity_bytes())
        self._outbox = Outbox(bus, spool, self._loops.add("outbox"))
        self._alarms = Alarms()
        self._source = ",".join(sorted(f"{robot}/{dfpc}" for robot, dfpc in owners))
        self._process, self._started_s = psutil.Process(), monotonic_s()
        self._hosted = [HostedDfpc(bus, self._outbox, robot, entry, sign) for robot, entry in entries]
        self._sensor_alarms = [SensorAlarms(self._alarms, robot.id, entry.name) for robot, entry in entries]

    def problem(self) -> str:
        """Return which thread does not work; empty if all do."""
        return "; ".join(problem for loops in (self._loops, self._bus.loops) if (problem := loops.problem()))

    def run(self, stop: threading.Event) -> None:
        """Configure the DFPCs, serve them and publish heartbeats until ``stop``; then close in order."""
        first = self._hosted[0]
        check = memory_check(self._alarms, self._source, memory_budget_mb())
        reporter = AlarmReporter(
            self._bus, first.robot.id, first.entry.name, self._alarms, self._loops.add("alarms"), (check,)
        )
        self._run(stop)
        reporter.close()

    def _run(self, stop: threading.Event) -> None:
        for hosted in self._hosted:
            self._serve(hosted)
        for hosted in self._hosted:
            if stop.is_set():
                return
            hosted.configure()
            hosted.reactivate()
            self._bus.declare_alive(hosted.robot.id, hosted.entry.name)
            self._publish_status(hosted)
            logger.info("%s of %s is ready", hosted.entry.name, hosted.robot.id)
        self._start_watchdog(stop)
        while not stop.wait(HEARTBEAT_S):
            set_outbox_alarms(self._alarms, self._source, self._outbox)
            for hosted, sensor_alarms in zip(self._hosted, self._sensor_alarms, strict=True):
                name = f"{hosted.robot.id}/{hosted.entry.name}"
                set_calibration_alarm(self._alarms, name, hosted.calibration)
                sensor_alarms.update(hosted.sensor_findings)
                self._publish_status(hosted)
        for hosted in self._hosted:
            hosted.close()
        self._outbox.close()

    def _serve(self, hosted: HostedDfpc) -> None:
        robot, name = hosted.robot.id, hosted.entry.name

        def call(request: Request) -> Reply:
            return _value_reply(*hosted.call(request.key.rsplit("/", 1)[1], request.parameters, BUSY_S))

        def store(request: Request) -> Reply:
            request.check_no_parameters()
            return _value_reply(*hosted.store_item(request.key.rsplit("/", 1)[1], BUSY_S))

        serve_life_cycle(
            self._bus, hosted, partial(self._status, hosted), partial(self._publish_status, hosted)
        )
        self._bus.serve(f"{keys.dfpc_rpc(robot, name, 'call')}/*", call, workers=2)
        self._bus.serve(keys.dfpc_store(robot, name, "*"), store, workers=2)

    def _status(self, hosted: HostedDfpc) -> dict[str, object]:
        return {
            **hosted.status(),
            "pid": self._process.pid,
            "uptime_s": monotonic_s() - self._started_s,
            "rss_mb": self._process.memory_info().rss / 1e6,
            "cpu_s": sum(self._process.cpu_times()[:2]),
            "outbox_pending": len(self._outbox.spool),
            "outbox_bytes": self._outbox.spool.bytes,
            "outbox_dropped": self._outbox.spool.dropped,
            "outbox_refused": self._outbox.refused,
            "outbox_error": self._outbox.last_error,
            "outbox_in_memory": self._outbox.spool.in_memory,
            "outbox_lost": self._outbox.spool.lost,
            "loops": self._loops.describe(),
        }

    def _publish_status(self, hosted: HostedDfpc) -> None:
        self._bus.publish_latched(keys.dfpc_status(hosted.robot.id, hosted.entry.name), self._status(hosted))

    def _start_watchdog(self, stop: threading.Event) -> None:
        watchdogs = [StepWatchdog(hosted.entry.step_timeout_s) for hosted in self._hosted]

        def wait() -> bool | None:
            return None if stop.wait(_WATCH_S) else True

        def watch(_: bool) -> None:
            for hosted, watchdog in zip(self._hosted, watchdogs, strict=True):
                started_s = hosted.step_started_s
                times = None if started_s is None else hosted.step_times()
                problem = watchdog.problem(started_s, monotonic_s(), times)
                if problem:
                    self._end_process(hosted, f"a step of {hosted.entry.name} {problem}")

        loop = self._loops.add("watchdog")
        threading.Thread(target=loop.run, args=(wait, watch), name="watchdog", daemon=True).start()

    def _end_process(self, hosted: HostedDfpc, reason: str) -> None:
        """End the process with a stalled step, since a thread cannot be stopped."""
        logger.error("%s; the process ends", reason)
        alarm = hosted.event(reason=reason) | {"state": "error"}
        self._bus.publish_map(keys.event(hosted.robot.id, "alarm"), alarm)
        time.sleep(_WATCH_S)  # time to send the alarm
        os._exit(EXIT_HUNG)


def _value_reply(value: object, provenance: dict[str, object]) -> Reply:
    """Return the reply with a value: plain data as MessagePack, types in UPER with their header."""
    if value is None or isinstance(value, (bool, int, float, str, list, dict)):
        return Reply.of(value, **provenance)
    return Reply(*encode_payload(value), {"kind": "product", **provenance})

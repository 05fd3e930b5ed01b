# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A process that hosts DFPCs: endpoints, heartbeat, watchdog."""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Sequence

import psutil

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.clock import monotonic_s
from cdff_common.codecs import encode
from cdff_common.codecs.encoding import encoding_string
from cdff_common.codecs.siblings import wire_type
from cdff_common.errors import InputError
from cdff_common.interfaces.profile import DfpcEntry, Robot
from services.dfpc_host.hosted import HostedDfpc
from services.dfpc_host.outbox import Outbox
from services.dfpc_host.spool import Spool, capacity_bytes, spool_folder

logger = logging.getLogger(__name__)

HEARTBEAT_S = 1.0
#: How long an operation or store query waits for the step that is running, seconds.
BUSY_S = 4.0
#: Exit code of a process that its watchdog ended; the supervisor starts it again.
EXIT_HUNG = 75


class DfpcHost:
    """Hosts the DFPCs of one process until told to stop."""

    def __init__(self, bus: Bus, entries: Sequence[tuple[Robot, DfpcEntry]]) -> None:
        self._bus = bus
        owners = [(robot.id, entry.name) for robot, entry in entries]
        self._outbox = Outbox(bus, Spool(spool_folder(), owners, capacity_bytes()))
        self._process = psutil.Process()
        self._hosted = [HostedDfpc(bus, self._outbox, robot, entry) for robot, entry in entries]

    def run(self, stop: threading.Event) -> None:
        """Configure, answer, step and beat until ``stop``; then close in order."""
        for hosted in self._hosted:
            self._serve(hosted)
        for hosted in self._hosted:
            if stop.is_set():
                return
            hosted.configure()
            hosted.reactivate()
            self._bus.declare_alive(hosted.robot.id, hosted.entry.name)
            self._beat(hosted)
            logger.info("%s of %s is ready", hosted.entry.name, hosted.robot.id)
        threading.Thread(target=self._watch, args=(stop,), name="watchdog", daemon=True).start()
        while not stop.wait(HEARTBEAT_S):
            for hosted in self._hosted:
                self._beat(hosted)
        for hosted in self._hosted:
            hosted.close()
        self._outbox.close()

    def _serve(self, hosted: HostedDfpc) -> None:
        robot, name = hosted.robot.id, hosted.entry.name

        def describe(request: Request) -> Reply:
            request.check_parameters()
            return Reply.of(hosted.describe())

        def status(request: Request) -> Reply:
            request.check_parameters()
            return Reply.of(self._status(hosted))

        def configure(request: Request) -> Reply:
            request.check_parameters()
            body = request.body() if request.payload else None
            if body is not None and not isinstance(body, dict):
                raise InputError(f"configure: body is a {type(body).__name__}, expected a map of parameters")
            hosted.configure(body)
            return Reply.of({"state": str(hosted.state)}, changes=hosted.changes)

        def activate(request: Request) -> Reply:
            request.check_parameters()
            body = request.body() if request.payload else {}
            inputs = body.get("inputs", {}) if isinstance(body, dict) else None
            if not isinstance(inputs, dict):
                raise InputError("activate: expected a body {inputs: {port: source}}, or none")
            hosted.activate({str(port): str(source) for port, source in inputs.items()})
            self._beat(hosted)
            return Reply.of({"state": str(hosted.state)}, changes=hosted.changes)

        def deactivate(request: Request) -> Reply:
            request.check_parameters()
            hosted.deactivate()
            self._beat(hosted)
            return Reply.of({"state": str(hosted.state)}, changes=hosted.changes)

        def clean_up(request: Request) -> Reply:
            request.check_parameters()
            hosted.clean_up()
            self._beat(hosted)
            return Reply.of({"state": str(hosted.state)}, changes=hosted.changes)

        def call(request: Request) -> Reply:
            return _value(hosted.call(request.key.rsplit("/", 1)[1], request.parameters, BUSY_S))

        def store(request: Request) -> Reply:
            request.check_parameters()
            return _value(hosted.store_item(request.key.rsplit("/", 1)[1], BUSY_S))

        verbs = {
            "describe": describe,
            "status": status,
            "configure": configure,
            "activate": activate,
            "deactivate": deactivate,
            "clean_up": clean_up,
        }
        for verb, handler in verbs.items():
            self._bus.serve(keys.dfpc_rpc(robot, name, verb), handler, workers=1)
        self._bus.serve(f"{keys.dfpc_rpc(robot, name, 'call')}/*", call, workers=2)
        self._bus.serve(keys.dfpc_store(robot, name, "*"), store, workers=2)

    def _status(self, hosted: HostedDfpc) -> dict[str, object]:
        memory = self._process.memory_info()
        return {
            **hosted.status(),
            "pid": self._process.pid,
            "rss_mb": memory.rss / 1e6,
            "cpu_s": sum(self._process.cpu_times()[:2]),
            "outbox_pending": self._outbox.pending,
            "outbox_bytes": self._outbox.pending_bytes,
            "outbox_dropped": self._outbox.dropped,
            "outbox_refused": self._outbox.refused,
            "outbox_error": self._outbox.last_error,
        }

    def _beat(self, hosted: HostedDfpc) -> None:
        self._bus.publish_latched(keys.dfpc_status(hosted.robot.id, hosted.entry.name), self._status(hosted))

    def _watch(self, stop: threading.Event) -> None:
        """End the process when a step hangs: Python cannot stop a thread, the supervisor can start a process."""
        while not stop.wait(0.2):
            for hosted in self._hosted:
                started_s = hosted.step_started_s
                if started_s is not None and monotonic_s() - started_s > hosted.entry.step_timeout_s:
                    reason = f"a step of {hosted.entry.name} runs longer than {hosted.entry.step_timeout_s:g} s"
                    logger.error("%s; the process ends", reason)
                    self._bus.publish_map(
                        keys.event(hosted.robot.id, "alarm"),
                        {"robot": hosted.robot.id, "dfpc": hosted.entry.name, "state": "error", "reason": reason},
                    )
                    stop.wait(0.2)  # let the alarm leave
                    os._exit(EXIT_HUNG)


def _value(found: tuple[object, dict[str, object]]) -> Reply:
    """A value of an operation or store item as a reply: plain data as MessagePack, types as UPER with their header."""
    value, provenance = found
    if value is None or isinstance(value, (bool, int, float, str, list, dict)):
        return Reply.of(value, **provenance)
    encoding = encoding_string(wire_type(value), "uper")
    return Reply(encode(value, "uper"), encoding, {"kind": "product", **provenance})

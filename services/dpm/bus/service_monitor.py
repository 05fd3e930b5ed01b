# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Monitor of the other services: DFPC states, liveliness, events for the history."""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from typing import Any

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import on_map, unpack
from cdff_common.errors import CdffError
from cdff_common.interfaces.profile import Robot
from services.dpm.operations.dpm import OWN_EVENTS, Dpm
from services.dpm.operations.overview import overview
from services.dpm.operations.service_health import service_health

logger = logging.getLogger(__name__)

#: Fields of a status from which the load of a DFPC is computed.
_TIMES = ("uptime_s", "step_cpu_s")


class ServiceMonitor:
    """Follows status keys, liveliness tokens and events on the bus.

    ``service`` is the name of this process. Only the DPM itself enters the events in the history; its workers
    do not.
    """

    def __init__(self, bus: Bus, dpm: Dpm, robots: Sequence[Robot] = (), *, service: str = "dpm") -> None:
        self._dpm, self._service = dpm, service
        self._robots = {robot.id: robot for robot in robots}
        #: By robot that has joined: revision of its profile.
        self._joined: dict[str, str] = {}
        self._left: set[str] = set()
        self._lock = threading.Lock()
        self._dfpcs: dict[tuple[str, str], dict[str, Any]] = {}
        self._alive: set[tuple[str, str]] = set()
        #: Mission time at which a service that was alive ended.
        self._ended_ns: dict[tuple[str, str], int] = {}
        #: By robot and sensor: body of the newest ``event/sensor_mode``.
        self._modes: dict[tuple[str, str], dict[str, Any]] = {}
        bus.subscribe(keys.dfpc_status("*", "*"), on_map(self._on_status), depth=256)
        bus.subscribe(keys.alarms("*", "*"), on_map(self._on_alarms), depth=256)
        bus.subscribe(keys.event("*", "*"), self._on_event, depth=1024)
        bus.watch_alive(keys.alive("*", "*"), self._on_alive)

    def set_robot(self, robot: Robot, revision: str) -> None:
        """Follow a robot that has joined, or another revision of its profile."""
        with self._lock:
            self._robots = {**self._robots, robot.id: robot}
            self._joined[robot.id] = revision
            self._left.discard(robot.id)

    def remove_robot(self, robot: str) -> None:
        """Remove the streams and DFPCs of a robot that has left."""
        with self._lock:
            self._robots = {r: known for r, known in self._robots.items() if r != robot}
            self._joined.pop(robot, None)
            self._left.add(robot)
            self._dfpcs = {k: v for k, v in self._dfpcs.items() if k[0] != robot}
            self._modes = {k: v for k, v in self._modes.items() if k[0] != robot}
            self._ended_ns = {k: v for k, v in self._ended_ns.items() if k[0] != robot}

    def revision(self, robot: str) -> str:
        """Return the revision of the profile with which a robot has joined; empty for others."""
        with self._lock:
            return self._joined.get(robot, "")

    def has_left(self, robot: str) -> bool:
        """Return True for a robot that had joined and has left."""
        with self._lock:
            return robot in self._left

    def dfpcs(self, robot: str) -> list[dict[str, Any]]:
        """Return the newest status of each DFPC of a robot, with the liveliness of its process."""
        with self._lock:
            return [
                {**body, "alive": (robot, name) in self._alive}
                for (owner, name), body in sorted(self._dfpcs.items())
                if owner == robot
            ]

    def all_dfpcs(self) -> list[dict[str, Any]]:
        """Return the newest status of each DFPC of all robots, with the liveliness of its process."""
        with self._lock:
            return [
                {**body, "robot": robot, "name": name, "alive": (robot, name) in self._alive}
                for (robot, name), body in sorted(self._dfpcs.items())
            ]

    def overview(self) -> dict[str, Any]:
        """Return the tables of streams, DFPCs and newest products."""
        return overview(tuple(self._robots.values()), self.all_dfpcs(), self.modes())

    def modes(self) -> dict[tuple[str, str], dict[str, Any]]:
        """Return the mode of each sensor that has changed since the start, by robot and sensor."""
        with self._lock:
            return dict(self._modes)

    def services(self) -> dict[str, list[str]]:
        """Return the services that are alive, by scope."""
        with self._lock:
            services: dict[str, list[str]] = {}
            for scope, service in sorted(self._alive):
                services.setdefault(scope, []).append(service)
            return services

    def health(self) -> list[dict[str, Any]]:
        """Return the health of each service in words (``service_health``)."""
        with self._lock:
            last_seen_ns: dict[tuple[str, str], int | None] = {**self._ended_ns}
            last_seen_ns |= dict.fromkeys(self._alive)
            expected = [(robot.id, entry.name) for robot in self._robots.values() for entry in robot.dfpcs]
        alarms = self._dpm.alarm_board.active()
        now_ns = self._dpm.store.clock.now_ns()
        return service_health(last_seen_ns, expected, self.all_dfpcs(), alarms, now_ns)

    def robots(self) -> set[str]:
        """Return the scopes of every service and status seen, without ``ground``."""
        with self._lock:
            return {scope for scope, _ in (*self._alive, *self._dfpcs)} - {keys.GROUND}

    def _on_status(self, key: str, body: dict[str, Any]) -> None:
        parts = key.split("/")
        owner = (parts[2], parts[4])
        with self._lock:
            cores = _cpu_cores(self._dfpcs.get(owner), body)
            self._dfpcs[owner] = body if cores is None else {**body, "cpu_cores": cores}

    def _on_alarms(self, key: str, body: dict[str, Any]) -> None:
        _, _, scope, _, service = key.split("/")
        if (scope, service) != (keys.GROUND, self._service):  # its own alarms are known without the bus
            self._dpm.alarm_board.report(scope, service, body["items"])

    def _on_alive(self, key: str, is_alive: bool) -> None:
        parts = key.split("/")
        with self._lock:
            service = parts[2], parts[4]
            if is_alive:
                self._alive.add(service)
                self._ended_ns.pop(service, None)
            elif service in self._alive:
                self._alive.remove(service)
                self._ended_ns[service] = self._dpm.store.clock.now_ns()

    def _on_event(self, message: Message) -> None:
        _, _, scope, _, kind = message.key.split("/")
        if kind in OWN_EVENTS:
            return
        try:
            body = unpack(message.payload)
            if kind == "sensor_mode" and isinstance(body, dict):
                with self._lock:
                    self._modes[(scope, str(body.get("sensor")))] = body
            if self._service != "dpm":
                return
            self._dpm.writer.record(scope, kind, body if isinstance(body, dict) else {"body": body})
        except CdffError as error:
            logger.warning("event on %s not stored: %s", message.key, error)


def _cpu_cores(before: dict[str, Any] | None, body: dict[str, Any]) -> float | None:
    """Return the CPU time of the steps between two statuses, cores; None without a previous status.

    The time between them is that of the host's uptime, so that a delayed message does not change the result.
    """
    if before is None or any(name not in status for name in _TIMES for status in (before, body)):
        return None
    elapsed_s = body["uptime_s"] - before["uptime_s"]
    if elapsed_s < 0.2:  # another process, or a status out of turn
        return before.get("cpu_cores") if elapsed_s >= 0 else None
    return max(float(body["step_cpu_s"] - before["step_cpu_s"]), 0.0) / float(elapsed_s)

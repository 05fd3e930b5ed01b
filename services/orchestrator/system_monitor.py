# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Subscriptions that update the system state: liveliness, heartbeats, sensor modes and insertions."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import on_map
from cdff_common.errors import CodecError, UnavailableError
from cdff_common.loops import Loops
from cdff_core.orchestration.catalogue import provider_of
from cdff_core.orchestration.reconciliation import Configuration
from cdff_core.orchestration.world import ProviderId, SensorId
from services.orchestrator.state import SystemState
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)

#: Longest duration of a call, and of the work after a new token, seconds.
_CALL_S, _BUSY_LIMIT_S = 3.0, 60.0


class SystemMonitor:
    """Subscriber of all messages about DFPCs, sensors and the DPM.

    A separate thread makes the calls after a new token (describe, modes), since the thread of the token
    callback must not block.
    """

    def __init__(self, bus: Bus, state: SystemState, loops: Loops, timing: Timing = REAL) -> None:
        self._bus = bus
        self._state = state
        self._timing = timing
        self._loop = loops.add("watcher", _BUSY_LIMIT_S)
        self._work = timing.queue()
        self._tokens: set[ProviderId] = set()
        self._described: set[ProviderId] = set()

    def start(self) -> None:
        """Subscribe; existing tokens and latched messages arrive at once."""
        self._timing.start(self._run, "watcher")
        self._bus.watch_alive(keys.alive("*", "*"), self._on_alive)
        self._bus.subscribe(keys.dfpc_status("*", "*"), on_map(self._on_status), depth=256)
        self._bus.subscribe(keys.event("*", "sensor_mode"), on_map(self._on_mode), depth=256)
        self._bus.subscribe(keys.event("*", "inserted"), on_map(self._on_inserted), depth=256)
        self._bus.subscribe(keys.event("*", "alarm"), on_map(self._on_alarm), depth=64)

    def follow(self, robot: str) -> None:
        """Query the processes of a robot that has joined or changed: their tokens may have come before."""
        self._work.put(lambda: self._find_processes(robot))

    def _find_processes(self, robot: str) -> None:
        for provider in [p for p in (*self._tokens, *self._described) if p.robot == robot]:
            self._tokens.discard(provider)
            self._described.discard(provider)
        for token in self._bus.alive(keys.alive(robot, "*")):
            self._on_alive(token, True)

    def close(self) -> None:
        """Stop the thread."""
        self._work.put(None)

    def _run(self) -> None:
        self._loop.run(self._work.get, _execute)

    def _on_alive(self, key: str, alive: bool) -> None:
        scope, service = key.split("/")[2], key.rsplit("/", 1)[1]
        provider = ProviderId(scope, service)
        if service == "icu" and alive and scope != keys.GROUND:
            self._work.put(lambda: self._query_modes(scope))
        elif self._state.has_provider(provider):
            if alive:
                self._tokens.add(provider)
                self._work.put(lambda: self._describe(provider))
            else:
                logger.info("%s has disappeared", provider)
                self._tokens.discard(provider)
                self._described.discard(provider)
                self._state.set_alive(provider, alive=False)

    def _describe(self, provider: ProviderId) -> None:
        """Query description and state of a new DFPC; after a failure the next heartbeat repeats the query."""
        if provider in self._described:
            return
        description = self._bus.call(keys.dfpc_rpc(*provider, "describe"), timeout_s=_CALL_S).body()
        provider_of(description, alive=True, active=False)
        self._state.set_description(provider, description)
        if provider not in self._tokens:
            return
        self._described.add(provider)
        self._state.set_state(provider, str(description.get("state", "")))
        self._state.set_alive(provider, alive=True)
        logger.info("%s is available, %s", provider, description.get("state"))

    def _query_modes(self, robot: str) -> None:
        body = self._bus.call(keys.icu_rpc(robot, "modes"), timeout_s=_CALL_S).body()
        for sensor, event in _modes_of(body, robot).items():
            self._state.set_mode(sensor, event["mode"], _lost(event))

    def _on_status(self, key: str, body: dict[str, Any]) -> None:
        parts = key.split("/")
        provider = ProviderId(parts[2], parts[4])
        if provider in self._tokens and provider not in self._described:
            self._work.put(lambda: self._describe(provider))
        if provider in self._described and "state" in body:
            wired, changes = body.get("wired"), body.get("changes")
            self._state.set_state(
                provider,
                str(body["state"]),
                str(body.get("last_error", "")),
                wired if isinstance(wired, dict) else None,
                changes if isinstance(changes, int) else None,
                _configuration(body),
            )
            self._state.add_status(provider, body)

    def _on_mode(self, key: str, body: dict[str, Any]) -> None:
        robot = key.split("/")[2]
        for sensor, event in _modes_of({"sensors": {str(body["sensor"]): body}}, robot).items():
            self._state.set_mode(sensor, event["mode"], _lost(event))

    def _on_inserted(self, key: str, body: dict[str, Any]) -> None:
        self._state.add_insertion(key.split("/")[2], str(body.get("product", "")))

    def _on_alarm(self, key: str, body: dict[str, Any]) -> None:
        provider = ProviderId(key.split("/")[2], str(body.get("dfpc", "")))
        if self._state.has_provider(provider) and body.get("state") == "error":
            self._state.set_state(provider, "error", str(body.get("reason", "")))


def _execute(task: Callable[[], None]) -> None:
    """Run a task; no answer is expected from time to time, and the next heartbeat repeats the task."""
    try:
        task()
    except UnavailableError as error:
        logger.warning("%s", error)


def _configuration(body: Mapping[str, Any]) -> Configuration | None:
    """Return the configuration in the status of a DFPC; None if it is missing or malformed."""
    adjusted = body.get("adjusted")
    if not isinstance(adjusted, dict) or not isinstance(body.get("implementation"), str):
        return None
    try:
        parameters = sorted((str(name), float(value)) for name, value in adjusted.items())
    except (TypeError, ValueError):
        return None
    return Configuration(body["implementation"], tuple(parameters))


def _lost(body: Mapping[str, object]) -> str:
    """Return why a sensor is lost, as reported by the instrument control unit; empty otherwise."""
    if body.get("state") != "lost":
        return ""
    return str(body.get("reason") or "reported by the instrument control unit")


def _modes_of(body: Any, robot: str) -> dict[SensorId, Mapping[str, Any]]:
    """Return the events in an answer ``{sensors: {name: event}}``; raises CodecError if it is malformed."""
    sensors = body.get("sensors") if isinstance(body, dict) else None
    if not isinstance(sensors, dict):
        raise CodecError(f"modes of {robot}: got {str(body)[:80]}, expected a map with 'sensors'")
    for name, event in sensors.items():
        if not isinstance(event, dict) or not isinstance(event.get("mode"), str):
            raise CodecError(f"modes of {robot}: sensor {name!r} has no mode in {str(event)[:80]}")
    return {SensorId(robot, str(name)): event for name, event in sensors.items()}

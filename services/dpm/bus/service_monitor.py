# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Monitor of the other services: DFPC states, liveliness, events for the history."""

from __future__ import annotations

import logging
import threading
from typing import Any

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import on_map, unpack
from cdff_common.errors import CdffError
from services.dpm.operations.dpm import OWN_EVENTS, Dpm

logger = logging.getLogger(__name__)


class ServiceMonitor:
    """Follows status keys, liveliness tokens and events on the bus."""

    def __init__(self, bus: Bus, dpm: Dpm) -> None:
        self._dpm = dpm
        self._lock = threading.Lock()
        self._dfpcs: dict[tuple[str, str], dict[str, Any]] = {}
        self._alive: set[tuple[str, str]] = set()
        bus.subscribe(keys.dfpc_status("*", "*"), on_map(self._on_status), depth=256)
        bus.subscribe(keys.alarms("*", "*"), on_map(self._on_alarms), depth=256)
        bus.subscribe(keys.event("*", "*"), self._on_event, depth=1024)
        bus.watch_alive(keys.alive("*", "*"), self._on_alive)

    def dfpcs(self, robot: str) -> list[dict[str, Any]]:
        """Return the newest status of each DFPC of a robot, with the liveliness of its process."""
        with self._lock:
            return [
                {**body, "alive": (robot, name) in self._alive}
                for (owner, name), body in sorted(self._dfpcs.items())
                if owner == robot
            ]

    def services(self) -> dict[str, list[str]]:
        """Return the services that are alive, by scope."""
        with self._lock:
            services: dict[str, list[str]] = {}
            for scope, service in sorted(self._alive):
                services.setdefault(scope, []).append(service)
            return services

    def robots(self) -> set[str]:
        """Return the scopes of every service and status seen, without ``ground``."""
        with self._lock:
            return {scope for scope, _ in (*self._alive, *self._dfpcs)} - {keys.GROUND}

    def _on_status(self, key: str, body: dict[str, Any]) -> None:
        parts = key.split("/")
        with self._lock:
            self._dfpcs[(parts[2], parts[4])] = body

    def _on_alarms(self, key: str, body: dict[str, Any]) -> None:
        _, _, scope, _, service = key.split("/")
        if (scope, service) != (keys.GROUND, "dpm"):  # its own alarms are known without the bus
            self._dpm.alarm_board.report(scope, service, body["items"])

    def _on_alive(self, key: str, is_alive: bool) -> None:
        parts = key.split("/")
        with self._lock:
            (self._alive.add if is_alive else self._alive.discard)((parts[2], parts[4]))

    def _on_event(self, message: Message) -> None:
        _, _, scope, _, kind = message.key.split("/")
        if kind in OWN_EVENTS:
            return
        try:
            body = unpack(message.payload)
            self._dpm.writer.record(scope, kind, body if isinstance(body, dict) else {"body": body})
        except CdffError as error:
            logger.warning("event on %s not stored: %s", message.key, error)

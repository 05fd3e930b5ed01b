# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the other services say of themselves: DFPC states, who is alive, events for the history."""

from __future__ import annotations

import logging
import threading
from typing import Any

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import unpack
from cdff_common.errors import CdffError
from services.dpm.operations import OWN_EVENTS, Dpm

logger = logging.getLogger(__name__)


class Watch:
    """Follows status keys, liveliness tokens and events on the bus."""

    def __init__(self, bus: Bus, dpm: Dpm) -> None:
        self._dpm = dpm
        self._lock = threading.Lock()
        self._dfpcs: dict[tuple[str, str], dict[str, Any]] = {}
        self._alive: set[tuple[str, str]] = set()
        bus.subscribe(keys.dfpc_status("*", "*"), self._on_status, depth=256)
        bus.subscribe(keys.event("*", "*"), self._on_event, depth=1024)
        bus.watch_alive(keys.alive("*", "*"), self._on_alive)

    def dfpcs(self, robot: str) -> list[dict[str, Any]]:
        """Newest status of each DFPC of a robot, with whether its process is alive."""
        with self._lock:
            return [
                {**body, "alive": (robot, name) in self._alive}
                for (owner, name), body in sorted(self._dfpcs.items())
                if owner == robot
            ]

    def services(self) -> dict[str, list[str]]:
        """Services that are alive, by scope."""
        with self._lock:
            found: dict[str, list[str]] = {}
            for scope, service in sorted(self._alive):
                found.setdefault(scope, []).append(service)
            return found

    def robots(self) -> set[str]:
        """Scopes that showed any sign of life, ``ground`` left out."""
        with self._lock:
            return {scope for scope, _ in (*self._alive, *self._dfpcs)} - {keys.GROUND}

    def _on_status(self, message: Message) -> None:
        parts = message.key.split("/")
        try:
            body = unpack(message.payload)
        except CdffError as error:
            logger.warning("malformed status on %s: %s", message.key, error)
            return
        if isinstance(body, dict):
            with self._lock:
                self._dfpcs[(parts[2], parts[4])] = body

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
            self._dpm.record(scope, kind, body if isinstance(body, dict) else {"body": body})
        except CdffError as error:
            logger.warning("event on %s not kept: %s", message.key, error)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keeps the state true: liveliness tokens, descriptions, heartbeats of DFPCs, confirmed sensor modes, insertions."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import unpack
from cdff_common.errors import CdffError, InputError
from cdff_core.orchestration.catalogue import maker_of
from cdff_core.orchestration.world import MakerId, SensorId
from services.orchestrator.state import State
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)

_CALL_S = 3.0


class Watcher:
    """Subscribes everything the orchestrator has to hear.

    Calls that a token leads to (describe, status, modes) are made in a thread of their own: the thread that brings
    tokens must not wait.
    """

    def __init__(self, bus: Bus, state: State, timing: Timing = REAL) -> None:
        self._bus = bus
        self._state = state
        self._timing = timing
        self._work = timing.queue()
        self._tokens: set[MakerId] = set()
        self._met: set[MakerId] = set()

    def start(self) -> None:
        """Subscribe; what is there already is heard of at once."""
        self._timing.start(self._run, "watcher")
        self._bus.watch_alive(keys.alive("*", "*"), self._on_alive)
        self._bus.subscribe(keys.dfpc_status("*", "*"), self._on_status, depth=256)
        self._bus.subscribe(keys.event("*", "sensor_mode"), self._on_mode, depth=256)
        self._bus.subscribe(keys.event("*", "inserted"), self._on_inserted, depth=256)
        self._bus.subscribe(keys.event("*", "alarm"), self._on_alarm, depth=64)

    def close(self) -> None:
        """Stop the thread."""
        self._work.put(None)

    def _run(self) -> None:
        task: Callable[[], None] | None
        while (task := self._work.get()) is not None:
            try:
                task()
            except CdffError as error:
                logger.warning("%s", error)

    def _on_alive(self, key: str, alive: bool) -> None:
        scope, service = key.split("/")[2], key.rsplit("/", 1)[1]
        maker = MakerId(scope, service)
        if service == "icu" and alive and scope != keys.GROUND:
            self._work.put(lambda: self._ask_modes(scope))
        elif self._state.knows(maker):
            if alive:
                self._tokens.add(maker)
                self._work.put(lambda: self._meet(maker))
            else:
                logger.info("%s is gone", maker)
                self._tokens.discard(maker)
                self._met.discard(maker)
                self._state.seen_alive(maker, alive=False)

    def _meet(self, maker: MakerId) -> None:
        """Ask a DFPC that appeared what it is and in which state; after a failed try a heartbeat leads here again."""
        if maker in self._met:
            return
        description = self._bus.call(keys.dfpc_rpc(*maker, "describe"), timeout_s=_CALL_S).body()
        maker_of(description, alive=True, active=False)
        self._state.described(maker, description)
        if maker not in self._tokens:
            return
        self._met.add(maker)
        self._state.seen_state(maker, str(description.get("state", "")))
        self._state.seen_alive(maker, alive=True)
        logger.info("%s is there, %s", maker, description.get("state"))

    def _ask_modes(self, robot: str) -> None:
        body = self._bus.call(keys.icu_rpc(robot, "modes"), timeout_s=_CALL_S).body()
        for name, sensor in body["sensors"].items():
            self._state.seen_mode(SensorId(robot, str(name)), str(sensor["mode"]), _lost(sensor))

    def _on_status(self, message: Message) -> None:
        parts = message.key.split("/")
        maker = MakerId(parts[2], parts[4])
        body = _map_of(message)
        if maker in self._tokens and maker not in self._met:
            self._work.put(lambda: self._meet(maker))
        if maker in self._met and "state" in body:
            wired, changes = body.get("wired"), body.get("changes")
            self._state.seen_state(
                maker,
                str(body["state"]),
                str(body.get("last_error", "")),
                wired if isinstance(wired, dict) else None,
                changes if isinstance(changes, int) else None,
            )
            try:
                self._state.seen_status(maker, body)
            except InputError as error:
                logger.warning("%s: %s", message.key, error)

    def _on_mode(self, message: Message) -> None:
        body = _map_of(message)
        if "sensor" in body and "mode" in body:
            self._state.seen_mode(
                SensorId(message.key.split("/")[2], str(body["sensor"])), str(body["mode"]), _lost(body)
            )

    def _on_inserted(self, message: Message) -> None:
        self._state.seen_inserted(str(_map_of(message).get("product", "")))

    def _on_alarm(self, message: Message) -> None:
        body = _map_of(message)
        maker = MakerId(message.key.split("/")[2], str(body.get("dfpc", "")))
        if self._state.knows(maker) and body.get("state") == "error":
            self._state.seen_state(maker, "error", str(body.get("reason", "")))


def _lost(body: Mapping[str, object]) -> str:
    """Why a sensor is lost, as the instrument control unit says; empty where it is not."""
    return str(body.get("reason") or "its unit says so") if body.get("state") == "lost" else ""


def _map_of(message: Message) -> dict[str, object]:
    """The message's MessagePack map; empty, and logged, for anything else."""
    try:
        body = unpack(message.payload)
    except CdffError as error:
        logger.warning("malformed message on %s: %s", message.key, error)
        return {}
    return body if isinstance(body, dict) else {}

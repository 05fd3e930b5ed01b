# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Control of robots by several orchestrators: one for each robot, and one on the ground.

The owner of a robot is its own orchestrator while that is on the bus, otherwise the one on the ground. Only
the owner switches the DFPCs and sensors of a robot; open requests stay with the orchestrator that accepted
them. The ground takes over when the liveliness token of a robot's orchestrator has been absent for
``TAKE_OVER_S``, and hands the robot back, with the DFPCs that it has activated, when the token returns.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping
from typing import Any

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import pack
from cdff_common.contract.limits import MAX_PAGE
from cdff_common.errors import CdffError, InputError
from cdff_common.loops import Loops
from cdff_core.orchestration.journal import RecoveredState, parse_provider_id, recover
from cdff_core.orchestration.world import ProviderId, SensorId
from services.orchestrator.delegations import Delegations
from services.orchestrator.journal import Journal
from services.orchestrator.reconciler import Reconciler
from services.orchestrator.state import SystemState
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)

#: Time without the token of a robot's orchestrator after which the ground takes over, seconds: a router that
#: reloads its access list closes its links for about one.
TAKE_OVER_S = 1.5
#: Longest wait for the running actions of a robot, period of the check, and pause after a refused hand-over,
#: seconds.
_ACTIONS_S, _PERIOD_S, _RETRY_S = 10.0, 0.02, 0.5
_CALL_S, _BUSY_LIMIT_S = 3.0, 120.0
#: Kinds of history records from which the changes of an orchestrator follow.
_KINDS = "activation,mode,control"


class Control:
    """Thread of the orchestrator on the ground that takes robots over and hands them back."""

    def __init__(
        self,
        bus: Bus,
        state: SystemState,
        reconciler: Reconciler,
        delegations: Delegations,
        journal: Journal,
        loops: Loops,
        timing: Timing = REAL,
    ) -> None:
        self._bus, self._state, self._journal, self._timing = bus, state, journal, timing
        self._reconciler, self._delegations = reconciler, delegations
        self._loop = loops.add("control of robots", _BUSY_LIMIT_S)
        self._changed: threading.Condition = timing.condition()
        self._due_s: dict[str, float] = {}
        self._present: set[str] = set()
        self._is_closed = False

    def start(self) -> None:
        """Follow the tokens; robots without an orchestrator are taken over."""
        for robot in self._state.robot_ids:
            self.follow(robot)
        self._timing.start(lambda: self._loop.run(self._next, self._update), "control of robots")
        self._bus.watch_alive(keys.alive("*", "orchestrator"), self._on_alive)

    def close(self) -> None:
        """Stop the thread."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def follow(self, robot: str) -> None:
        """Decide about a robot, which is not controlled from here until then."""
        self._state.set_control(robot, controlled=False)
        self._decide(robot, TAKE_OVER_S)

    def _decide(self, robot: str, after_s: float) -> None:
        with self._changed:
            self._due_s[robot] = self._timing.now_s() + after_s
            self._changed.notify_all()

    def _on_alive(self, key: str, is_alive: bool) -> None:
        robot = key.split("/")[2]
        if robot == keys.GROUND:
            return
        with self._changed:
            (self._present.add if is_alive else self._present.discard)(robot)
        self._decide(robot, 0.0 if is_alive else TAKE_OVER_S)

    def _next(self) -> str | None:
        """Wait for the next robot to decide about and return its id; return None once closed."""
        with self._changed:
            while not self._is_closed:
                robot = min(self._due_s, key=lambda name: self._due_s[name], default=None)
                wait_s = None if robot is None else self._due_s[robot] - self._timing.now_s()
                if robot is not None and wait_s is not None and wait_s <= 0.0:
                    del self._due_s[robot]
                    return robot
                self._changed.wait(wait_s)
            return None

    def _update(self, robot: str) -> None:
        with self._changed:
            is_present = robot in self._present
        if is_present and self._state.controls(robot):
            self._hand_back(robot)
        elif not is_present and not self._state.controls(robot):
            self._take_over(robot)

    def _take_over(self, robot: str) -> None:
        changes = self._recorded_changes(robot)
        self._record(robot, changes.owned, changes.modes, "taken over")
        self._state.recover(changes.owned, changes.modes)
        self._state.set_control(robot, controlled=True)
        self._delegations.update()
        logger.info("%s is taken over with %d active DFPCs", robot, len(changes.owned))

    def _recorded_changes(self, robot: str) -> RecoveredState:
        """Return what the orchestrator of a robot has changed, from the history; empty without a DPM."""
        records: list[Mapping[str, Any]] = []
        try:
            while True:
                since = int(records[-1]["ordinal"]) if records else 0
                query = {"kind": _KINDS, "scope": robot, "since": since, "limit": MAX_PAGE}
                key = keys.dpm_rpc(keys.GROUND, "history")
                items = self._bus.call(key, query, timeout_s=_CALL_S).body()["items"]
                records += items
                if len(items) < MAX_PAGE:
                    break
        except CdffError as error:
            logger.warning(
                "the DFPCs that the orchestrator of %s has activated are unknown: %s", robot, error
            )
        changes = recover(records)
        changes.owned = {p for p in changes.owned if p.robot == robot}
        changes.modes = {s for s in changes.modes if s.robot == robot}
        return changes

    def _hand_back(self, robot: str) -> None:
        self._state.set_control(robot, controlled=False)
        self._delegations.update()  # first, so that no DFPC in use is without a lease for long
        until_s, pause = self._timing.now_s() + _ACTIONS_S, self._timing.event()
        while self._reconciler.is_acting_on(robot) and self._timing.now_s() < until_s:
            pause.wait(_PERIOD_S)
        owned, sensors = self._state.take_changes(robot)
        body = {"owned": sorted(map(str, owned)), "sensors": sorted(map(str, sensors))}
        try:
            key = keys.orchestrator_rpc(robot, "hand_over")
            self._bus.call(key, payload=pack(body), timeout_s=_CALL_S, elsewhere=True)
        except CdffError as error:
            logger.warning("%s is not handed back: %s", robot, error)
            self._state.recover(owned, sensors)
            self._state.set_control(robot, controlled=True)
            self._decide(robot, _RETRY_S)
            return
        self._journal.append("control", robot=robot, action="hand_back")
        logger.info("%s is handed back with %d active DFPCs", robot, len(owned))

    def _record(self, robot: str, owned: set[ProviderId], sensors: set[SensorId], reason: str) -> None:
        self._journal.append("control", robot=robot, action="take_over")
        record_changes(self._journal, owned, sensors, reason)


def record_changes(journal: Journal, owned: set[ProviderId], sensors: set[SensorId], reason: str) -> None:
    """Write the DFPCs and sensors that this orchestrator owns from now on to its journal."""
    for provider in sorted(owned):
        journal.append("activation", dfpc=str(provider), action="activate", ok=True, reason=reason)
    for sensor in sorted(sensors):
        journal.append("mode", sensor=str(sensor), mode="", ok=True, reason=reason)


def parse_hand_over(body: Any, robot: str) -> tuple[set[ProviderId], set[SensorId]]:
    """Return the DFPCs and sensors in the body of ``hand_over``; raises InputError for a malformed one."""
    if not isinstance(body, dict) or set(body) - {"owned", "sensors"}:
        raise InputError(f"hand_over: got {str(body)[:80]!r}, expected a map of owned and sensors")
    pairs = {}
    for name in ("owned", "sensors"):
        texts = body.get(name, [])
        if not isinstance(texts, list) or not all(isinstance(t, str) for t in texts):
            raise InputError(f"hand_over: {name} is {str(texts)[:80]!r}, expected a list of {robot}/NAME")
        pairs[name] = {parse_provider_id(text) for text in texts}
        strange = sorted(str(p) for p in pairs[name] if p.robot != robot)
        if strange:
            raise InputError(f"hand_over: {name} contains {strange[0]!r}, expected {robot}/NAME")
    return pairs["owned"], {SensorId(*pair) for pair in pairs["sensors"]}

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
import math
import threading
from collections.abc import Mapping
from functools import partial
from typing import Any

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import pack
from cdff_common.contract.limits import MAX_PAGE
from cdff_common.errors import CdffError, InputError
from cdff_common.interfaces.profile import Robot
from cdff_common.loops import Loops
from cdff_core.orchestration.journal import RecoveredState, parse_provider_id, recover
from cdff_core.orchestration.world import ProviderId, SensorId
from services.orchestrator.delegations import Delegations
from services.orchestrator.history import history_origin
from services.orchestrator.journal import Journal
from services.orchestrator.reconciler import Reconciler
from services.orchestrator.state import SystemState
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)

#: Time without the token of a robot's orchestrator after which the ground takes over, seconds: a router that
#: reloads its access list closes its links for about one.
TAKE_OVER_S = 1.5
#: Period of the check for running actions, and pauses after an unanswered and after a refused call, seconds.
_PERIOD_S, _RETRY_S, _REFUSED_S = 0.02, 0.5, 10.0
_CALL_S, _BUSY_LIMIT_S = 3.0, 120.0
#: Kinds of history records from which the changes of an orchestrator follow.
_KINDS = "activation,mode"


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
        self._taken: set[str] = set()  # robots that are not handed back yet
        self._without_history: set[str] = set()  # taken robots whose active DFPCs are not known yet
        self._faults: dict[str, str] = {}  # last reported failure of each robot
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
        self._delegations.update()
        self._decide(robot, TAKE_OVER_S)

    def _decide(self, robot: str, after_s: float) -> None:
        with self._changed:
            self._due_s[robot] = self._timing.now_s() + after_s
            self._changed.notify_all()

    def _repeat(self, robot: str, after_s: float) -> None:
        """Decide again about a robot, unless its token has changed meanwhile; called by the thread only."""
        with self._changed:
            self._due_s.setdefault(robot, self._timing.now_s() + after_s)

    def _on_alive(self, key: str, is_alive: bool) -> None:
        robot = key.split("/")[2]
        if robot == keys.GROUND:
            return
        with self._changed:
            (self._present.add if is_alive else self._present.discard)(robot)
        if is_alive:
            self._delegations.follow(robot)
        self._decide(robot, 0.0 if is_alive else TAKE_OVER_S)

    def _next(self) -> str | None:
        """Wait for the next robot to decide about and return its id; return None once closed."""
        with self._changed:
            while not self._is_closed:
                robot = min(self._due_s, key=lambda name: self._due_s[name], default=None)
                due_s = math.inf if robot is None else self._due_s[robot]
                wait_s = due_s - self._timing.now_s()
                if robot is not None and wait_s <= 0.0:
                    del self._due_s[robot]
                    return robot
                has_changed = partial(self._is_earlier_than, due_s)
                self._changed.wait_for(has_changed, None if robot is None else wait_s)
            return None

    def _is_earlier_than(self, due_s: float) -> bool:
        """Return True if a decision is due earlier, or the thread shall end."""
        return self._is_closed or min(self._due_s.values(), default=math.inf) < due_s

    def _update(self, robot: str) -> None:
        with self._changed:
            is_present = robot in self._present
        if is_present:
            # An earlier process on the ground may have taken the robot over.
            if robot in self._taken or any(self._state.changes(robot)):
                self._hand_back(robot)
        elif not self._state.controls(robot):
            self._take_over(robot)
        elif robot in self._without_history:
            self._add_recorded_changes(robot)

    def _take_over(self, robot: str) -> None:
        self._journal.append("control", robot=robot, action="take_over")
        self._taken.add(robot)
        self._state.set_control(robot, controlled=True)
        self._delegations.update()
        logger.info("%s is taken over", robot)
        self._without_history.add(robot)
        self._repeat(robot, 0.0)  # after other robots that are due: the DPM may not answer

    def _add_recorded_changes(self, robot: str) -> None:
        """Own what the orchestrator of a robot has changed; repeated until the history can be read."""
        try:
            changes = self._recorded_changes(robot)
        except CdffError as error:
            self._report(robot, f"the DFPCs that its orchestrator has activated are unknown: {error}")
            self._repeat(robot, _RETRY_S)
            return
        self._without_history.discard(robot)
        record_changes(self._journal, changes.owned, changes.modes, "taken over")
        self._state.recover(changes.owned, changes.modes)
        logger.info("%s: %d active DFPCs of its orchestrator", robot, len(changes.owned))

    def _recorded_changes(self, robot: str) -> RecoveredState:
        """Return what the orchestrator of a robot has changed, from its records in the history."""
        records: list[Mapping[str, Any]] = []
        since = 0
        while True:
            query = {"kind": _KINDS, "scope": robot, "since": since, "limit": MAX_PAGE}
            reply = self._bus.call(keys.dpm_rpc(keys.GROUND, "history"), query, timeout_s=_CALL_S)
            items = reply.body()["items"]
            records += [item for item in items if item["origin"] == history_origin(robot)]
            if len(items) < MAX_PAGE:
                break
            since = int(items[-1]["ordinal"])
        changes = recover(records)
        changes.owned = {p for p in changes.owned if p.robot == robot}
        changes.modes = {s for s in changes.modes if s.robot == robot}
        return changes

    def _hand_back(self, robot: str) -> None:
        """End the control of a robot; its orchestrator gets the changes when the running actions have ended.

        Until it has accepted them they are kept, for a second attempt or another take-over.
        """
        if self._state.controls(robot):
            self._state.set_control(robot, controlled=False)
            self._delegations.update()  # first, so that no DFPC in use is without a lease for long
        if self._reconciler.is_acting_on(robot):
            self._repeat(robot, _PERIOD_S)
            return
        owned, sensors = self._state.changes(robot)
        body = {"owned": sorted(map(str, owned)), "sensors": sorted(map(str, sensors))}
        try:
            key = keys.orchestrator_rpc(robot, "hand_over")
            self._bus.call(key, payload=pack(body), timeout_s=_CALL_S, elsewhere=True)
        except CdffError as error:
            self._report(robot, f"its orchestrator does not take its DFPCs over: {error}")
            self._repeat(robot, _REFUSED_S if isinstance(error, InputError) else _RETRY_S)
            return
        self._journal.append("control", robot=robot, action="hand_back")
        self._state.drop_changes(robot)
        self._taken.discard(robot)
        self._without_history.discard(robot)
        self._faults.pop(robot, None)
        logger.info("%s is handed back with %d active DFPCs", robot, len(owned))

    def _report(self, robot: str, fault: str) -> None:
        """Log a failure that differs from the last one of the robot."""
        if self._faults.get(robot) != fault:
            self._faults[robot] = fault
            logger.warning("%s: %s", robot, fault)


def record_changes(journal: Journal, owned: set[ProviderId], sensors: set[SensorId], reason: str) -> None:
    """Write the DFPCs and sensors that this orchestrator owns from now on to its journal."""
    for provider in sorted(owned):
        journal.append("activation", dfpc=str(provider), action="activate", ok=True, reason=reason)
    for sensor in sorted(sensors):
        journal.append("mode", sensor=str(sensor), mode="", ok=True, reason=reason)


def parse_hand_over(body: Any, robot: Robot) -> tuple[set[ProviderId], set[SensorId]]:
    """Return the DFPCs and sensors in the body of ``hand_over``.

    Raises
    ------
    InputError
        If it is malformed, or names a DFPC or sensor that the profile of the robot does not have.
    """
    if not isinstance(body, dict) or set(body) - {"owned", "sensors"}:
        raise InputError(f"hand_over: got {str(body)[:80]!r}, expected a map of owned and sensors")
    known = {"owned": {entry.name for entry in robot.dfpcs}, "sensors": set(robot.sensors)}
    pairs = {}
    for field, names in known.items():
        texts = body.get(field, [])
        if not isinstance(texts, list) or not all(isinstance(t, str) for t in texts):
            raise InputError(f"hand_over: {field} is {str(texts)[:80]!r}, expected a list of {robot.id}/NAME")
        pairs[field] = {parse_provider_id(text) for text in texts}
        strange = sorted(str(p) for p in pairs[field] if p.robot != robot.id or p.dfpc not in names)
        if strange:
            raise InputError(
                f"hand_over: {field} contains {strange[0]!r}, expected {robot.id}/NAME of the profile; both "
                "orchestrators need the same profile"
            )
    return pairs["owned"], {SensorId(*pair) for pair in pairs["sensors"]}

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Execution of the reconciliation actions: sensor modes and life-cycle calls of DFPCs."""

from __future__ import annotations

import logging
import threading
from dataclasses import replace
from typing import Any

from cdff_common import tracing
from cdff_common.bus import Bus, Reply, keys
from cdff_common.bus.message import pack
from cdff_common.errors import CdffError, CodecError, DeadlineError, DeniedError
from cdff_common.loops import Loops
from cdff_core.orchestration.reconciliation import (
    Acquire,
    Action,
    Activate,
    CleanUp,
    Configure,
    Deactivate,
    SetMode,
)
from cdff_core.orchestration.world import ProviderId, SensorId
from services.orchestrator.journal import Journal
from services.orchestrator.mode_alarms import ModeAlarms
from services.orchestrator.state import SystemState
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)

#: Longest wait between two evaluations, seconds; a change ends it.
_IDLE_S = 5.0
#: Limits of the calls; a request falls back to another plan within 10 s of a unit that hangs.
_MODE_TIMEOUT_S = 9.5
_DFPC_TIMEOUT_S = 5.0
#: Longest duration of one evaluation, seconds.
_BUSY_LIMIT_S = 60.0
_WORKERS = 8
_VERBS: dict[type[Action], str] = {
    Configure: "configure",
    Activate: "activate",
    Deactivate: "deactivate",
    CleanUp: "clean_up",
}


class Reconciler:
    """Thread that requests actions, and pool that executes one per DFPC or sensor at a time."""

    def __init__(
        self,
        bus: Bus,
        state: SystemState,
        journal: Journal,
        loops: Loops,
        mode_alarms: ModeAlarms,
        timing: Timing = REAL,
    ) -> None:
        self._bus = bus
        self._state = state
        self._journal = journal
        self._mode_alarms = mode_alarms
        self._timing = timing
        self._loop = loops.add("control", _BUSY_LIMIT_S)
        self._version, self._wait_s = -1, 0.0
        self._stop = timing.event()
        self._lock = timing.lock()
        self._busy: set[ProviderId | SensorId] = set()
        self._pool = timing.pool(_WORKERS, "control")
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Start the thread."""
        self._thread = self._timing.start(self._run, "control")

    def close(self) -> None:
        """Stop; running actions finish."""
        self._stop.set()
        self._state.notify()
        if self._thread is not None:
            self._thread.join(timeout=2.0)
        self._pool.shutdown(wait=False, cancel_futures=True)

    def is_acting_on(self, robot: str) -> bool:
        """Return True while an action for a robot is executed."""
        with self._lock:
            return any(subject.robot == robot for subject in self._busy)

    def _run(self) -> None:
        self._loop.run(self._wait, self._submit_actions)

    def _wait(self) -> bool | None:
        """Wait for a change or the time of the next action; return None once stopped."""
        self._state.wait(self._version, self._wait_s)
        return None if self._stop.is_set() else True

    def _submit_actions(self, _: object) -> None:
        self._version, self._wait_s = self._state.version, _IDLE_S
        actions, next_s = self._state.new_actions()
        for action in actions:
            subject = action.sensor if isinstance(action, SetMode | Acquire) else action.provider
            with self._lock:
                if subject in self._busy:
                    continue
                self._busy.add(subject)
            self._pool.submit(self._execute, action, subject)
        if next_s is not None:
            self._wait_s = min(max(next_s - self._timing.now_s(), 0.0), _IDLE_S)

    def _execute(self, action: Action, subject: ProviderId | SensorId) -> None:
        try:
            if not self._state.controls(subject.robot):
                return  # it was handed back since the action was decided
            if isinstance(action, SetMode | Acquire):
                self._set_mode(action)
            else:
                verb = _VERBS[type(action)]
                parent = tracing.kept(str(subject)) if verb == "activate" else ""
                with tracing.span(f"orchestrator.{verb}", parent):
                    self._switch(action, verb)
        except Exception as error:  # an unexpected error of one action; it is repeated after a back-off
            logger.exception("%s failed", action)
            self._state.add_failure(subject, f"{action}: {type(error).__name__}")
        finally:
            with self._lock:
                self._busy.discard(subject)
            self._state.notify(subject.robot)

    def _set_mode(self, action: SetMode | Acquire) -> None:
        sensor = action.sensor
        acquisition = action.acquisition if isinstance(action, Acquire) else None
        mode = action.mode if isinstance(action, SetMode) else action.acquisition.mode
        parameters = {"sensor": sensor.sensor, "mode": mode, "holder": "orchestrator"}
        timeout_s = _MODE_TIMEOUT_S
        if acquisition is not None:
            parameters["acquire"] = str(acquisition.parameters)
            timeout_s += acquisition.duration_s
        begun_ns = self._bus.mission_clock.now_ns()
        try:
            reply = self._bus.call(keys.icu_rpc(sensor.robot, "set_mode"), parameters, timeout_s=timeout_s)
            _check_confirmation(reply, mode)
        except CdffError as error:
            self._journal.append("mode", sensor=str(sensor), mode=mode, ok=False, reason=str(error))
            level = logging.INFO if self._mode_alarms.is_expected(error) else logging.WARNING
            logger.log(level, "mode %s of %s: %s", mode, sensor, error)
            self._mode_alarms.report(sensor, mode, error)
            reason = f"sensor {sensor} mode {mode}: {error}"
            if isinstance(error, DeniedError):
                self._state.add_mode_refusal(sensor, mode, f"sensor {sensor} refused mode {mode}: {error}")
            elif isinstance(error, (DeadlineError, CodecError)) or type(error) is CdffError:
                self._state.add_mode_refusal(sensor, mode, reason)
            else:  # no unit, a lost sensor or another demand: the mode itself may work
                self._state.add_failure(sensor, reason)
            return
        acquired: dict[str, Any] = {} if acquisition is None else {"acquired": str(acquisition.parameters)}
        self._journal.append("mode", sensor=str(sensor), mode=mode, ok=True, reason="", **acquired)
        self._mode_alarms.confirm(sensor, mode)
        self._state.clear_failures(sensor)
        if isinstance(action, Acquire):
            values = action.acquisition.parameters.to_dict()
            self._state.end_acquisition(action.holder, sensor, values, begun_ns)
            return
        self._state.add_mode_change(sensor)
        self._state.set_mode(sensor, mode)

    def _switch(self, action: Configure | Activate | Deactivate | CleanUp, verb: str) -> None:
        provider = action.provider
        if verb == "activate":
            # Recorded before the call: if this process dies meanwhile, the next one may deactivate the DFPC.
            self._journal.append("activation", dfpc=str(provider), action=verb, ok=True, reason="wanted")
            self._state.set_owned(provider, owned=True)
        try:
            inputs = dict(action.inputs) if isinstance(action, Activate) else {}
            configuration = action.configuration if isinstance(action, Activate) else None
            body: dict[str, Any] = {"inputs": inputs} if inputs else {}
            if configuration is not None:
                body["implementation"] = configuration.implementation
                body["parameters"] = dict(configuration.parameters)
            payload = pack(body) if body else b""
            reply = self._bus.call(keys.dfpc_rpc(*provider, verb), payload=payload, timeout_s=_DFPC_TIMEOUT_S)
            state = str(reply.body().get("state", ""))
        except CdffError as error:
            logger.warning("%s of %s: %s", verb, provider, error)
            self._journal.append("activation", dfpc=str(provider), action=verb, ok=False, reason=str(error))
            self._state.add_failure(provider, f"{verb} of {provider}: {error}")
            return
        reasons = {"deactivate": "no request needs it", "clean_up": "in error, and no request needs it"}
        if verb in reasons and state == "error":  # it is still owned, and will be cleaned up
            reason = f"{provider} failed at a queued sample"
            self._journal.append("activation", dfpc=str(provider), action=verb, ok=False, reason=reason)
            self._state.set_state(provider, state, reason)
            return
        if verb != "activate":
            self._journal.append(
                "activation", dfpc=str(provider), action=verb, ok=True, reason=reasons.get(verb, "wanted")
            )
        if verb in reasons:
            self._state.set_owned(provider, owned=False)
        logger.info("%s of %s: done", verb, provider)
        changes = reply.attachment.get("changes")
        self._state.set_state(
            provider,
            state,
            wired=inputs or None,
            changes=None if changes is None else int(changes),
            configuration=None
            if configuration is None
            else replace(configuration, implementation=reply.body().get("implementation")),
        )


def _check_confirmation(reply: Reply, mode: str) -> None:
    """Raise CodecError unless a reply of the instrument control unit confirms a mode."""
    body = reply.body()
    confirmed = body.get("confirmed") if isinstance(body, dict) else None
    reached = body.get("mode") if isinstance(body, dict) else None
    if confirmed is not True or reached != mode:
        raise CodecError(
            f"the instrument control unit answered confirmed: {confirmed!r}, mode: {reached!r}; "
            f"expected confirmed: True, mode: {mode!r}"
        )

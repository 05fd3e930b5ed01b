# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Execution of the reconciliation actions: sensor modes and life-cycle calls of DFPCs."""

from __future__ import annotations

import logging
import threading

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import pack
from cdff_common.errors import CdffError, DeniedError
from cdff_core.orchestration.reconciliation import Action, Activate, CleanUp, Configure, Deactivate, SetMode
from services.orchestrator.journal import Journal
from services.orchestrator.state import SystemState
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)

#: Longest wait between two evaluations, seconds; a change ends it.
_IDLE_S = 5.0
_MODE_TIMEOUT_S = 10.0
_DFPC_TIMEOUT_S = 5.0
_WORKERS = 8
_VERBS: dict[type[Action], str] = {
    Configure: "configure",
    Activate: "activate",
    Deactivate: "deactivate",
    CleanUp: "clean_up",
}


class Reconciler:
    """Thread that requests actions, and pool that executes one per DFPC or sensor at a time."""

    def __init__(self, bus: Bus, state: SystemState, journal: Journal, timing: Timing = REAL) -> None:
        self._bus = bus
        self._state = state
        self._journal = journal
        self._timing = timing
        self._stop = timing.event()
        self._lock = timing.lock()
        self._busy: set[object] = set()
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

    def _run(self) -> None:
        while not self._stop.is_set():
            version = self._state.version
            actions, next_s = self._state.actions()
            for action in actions:
                subject = action.sensor if isinstance(action, SetMode) else action.provider
                with self._lock:
                    if subject in self._busy:
                        continue
                    self._busy.add(subject)
                self._pool.submit(self._execute, action, subject)
            wait_s = _IDLE_S if next_s is None else min(max(next_s - self._timing.now_s(), 0.0), _IDLE_S)
            self._state.wait(version, wait_s)

    def _execute(self, action: Action, subject: object) -> None:
        try:
            if isinstance(action, SetMode):
                self._set_mode(action)
            else:
                self._switch(action, _VERBS[type(action)])
        except Exception:  # an unexpected error of one action is logged; the action is repeated
            logger.exception("%s failed", action)
        finally:
            with self._lock:
                self._busy.discard(subject)
            self._state.notify()

    def _set_mode(self, action: SetMode) -> None:
        sensor, mode = action.sensor, action.mode
        parameters = {"sensor": sensor.sensor, "mode": mode, "holder": "orchestrator"}
        try:
            self._bus.call(keys.icu_rpc(sensor.robot, "set_mode"), parameters, timeout_s=_MODE_TIMEOUT_S)
        except CdffError as error:
            if isinstance(error, DeniedError):
                self._state.add_mode_refusal(sensor, mode)
            self._journal.append("mode", sensor=str(sensor), mode=mode, ok=False, reason=str(error))
            logger.warning("mode %s of %s: %s", mode, sensor, error)
            self._state.add_failure(sensor, f"sensor {sensor} mode {mode}: {error}")
            return
        self._journal.append("mode", sensor=str(sensor), mode=mode, ok=True, reason="")
        self._state.clear_failures(sensor)
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
            payload = pack({"inputs": inputs}) if inputs else b""
            reply = self._bus.call(keys.dfpc_rpc(*provider, verb), payload=payload, timeout_s=_DFPC_TIMEOUT_S)
            state = str(reply.body().get("state", ""))
        except CdffError as error:
            logger.warning("%s of %s: %s", verb, provider, error)
            self._journal.append("activation", dfpc=str(provider), action=verb, ok=False, reason=str(error))
            self._state.add_failure(provider, f"{verb} of {provider}: {error}")
            return
        reasons = {"deactivate": "no request needs it", "clean_up": "in error, and no request needs it"}
        if verb != "activate":
            self._journal.append(
                "activation", dfpc=str(provider), action=verb, ok=True, reason=reasons.get(verb, "wanted")
            )
        if verb in reasons:
            self._state.set_owned(provider, owned=False)
        logger.info("%s of %s: done", verb, provider)
        changes = reply.attachment.get("changes")
        self._state.set_state(
            provider, state, wired=inputs or None, changes=None if changes is None else int(changes)
        )

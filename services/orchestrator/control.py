# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Makes what runs follow what is wanted: carries out the actions of the reconciliation, over and over."""

from __future__ import annotations

import logging
import threading
from typing import assert_never

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import pack
from cdff_common.errors import CdffError, DeniedError
from cdff_core.orchestration.reconcile import Action, Activate, CleanUp, Configure, Deactivate, SetMode
from services.orchestrator.journal import Journal
from services.orchestrator.state import State
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)

#: Longest wait between two looks, seconds: events wake the loop before.
_IDLE_S = 5.0
_MODE_TIMEOUT_S = 10.0
_DFPC_TIMEOUT_S = 5.0
_WORKERS = 8


class Controller:
    """A thread that asks the state what to do, and a pool that does it; one action per DFPC or sensor at a time."""

    def __init__(self, bus: Bus, state: State, journal: Journal, timing: Timing = REAL) -> None:
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
        """Begin."""
        self._thread = self._timing.start(self._run, "control")

    def close(self) -> None:
        """Stop; actions under way are let finish."""
        self._stop.set()
        self._state.touch()
        if self._thread is not None:
            self._thread.join(timeout=2.0)
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _run(self) -> None:
        while not self._stop.is_set():
            seen = self._state.version
            actions, again_s = self._state.actions()
            for action in actions:
                subject = action.sensor if isinstance(action, SetMode) else action.maker
                with self._lock:
                    if subject in self._busy:
                        continue
                    self._busy.add(subject)
                self._pool.submit(self._carry_out, action, subject)
            wait_s = _IDLE_S if again_s is None else min(max(again_s - self._timing.now_s(), 0.0), _IDLE_S)
            self._state.wait(seen, wait_s)

    def _carry_out(self, action: Action, subject: object) -> None:
        try:
            if isinstance(action, SetMode):
                self._set_mode(action)
            elif isinstance(action, Configure):
                self._switch(action, "configure")
            elif isinstance(action, Activate):
                self._switch(action, "activate")
            elif isinstance(action, CleanUp):
                self._switch(action, "clean_up")
            elif isinstance(action, Deactivate):
                self._switch(action, "deactivate")
            else:
                assert_never(action)
        except Exception:  # the last line of defence of a pool: it is logged, and tried again
            logger.exception("%s failed", action)
        finally:
            with self._lock:
                self._busy.discard(subject)
            self._state.touch()

    def _set_mode(self, action: SetMode) -> None:
        sensor, mode = action.sensor, action.mode
        parameters = {"sensor": sensor.sensor, "mode": mode, "holder": "orchestrator"}
        error: CdffError | None = None
        try:
            self._bus.call(keys.icu_rpc(sensor.robot, "set_mode"), parameters, timeout_s=_MODE_TIMEOUT_S)
        except DeniedError as denied:
            self._state.refused(sensor, mode)
            error = denied
        except CdffError as known:
            error = known
        self._journal.append(
            "mode", sensor=str(sensor), mode=mode, ok=error is None, reason="" if error is None else str(error)
        )
        if error is None:
            self._state.succeeded(sensor)
            self._state.changed_mode(sensor)
            self._state.seen_mode(sensor, mode)
            return
        logger.warning("mode %s of %s: %s", mode, sensor, error)
        self._state.failed(sensor, f"sensor {sensor} mode {mode}: {error}")

    def _switch(self, action: Configure | Activate | Deactivate | CleanUp, verb: str) -> None:
        maker = action.maker
        if verb == "activate":
            # Before the call: if this process dies in between, the next one knows that it may switch the DFPC off.
            self._journal.append("activation", dfpc=str(maker), action=verb, ok=True, reason="wanted")
            self._state.own(maker, owned=True)
        try:
            chosen = dict(action.inputs) if isinstance(action, Activate) else {}
            payload = pack({"inputs": chosen}) if chosen else b""
            reply = self._bus.call(keys.dfpc_rpc(*maker, verb), payload=payload, timeout_s=_DFPC_TIMEOUT_S)
            state = str(reply.body().get("state", ""))
        except CdffError as error:
            logger.warning("%s of %s: %s", verb, maker, error)
            self._journal.append("activation", dfpc=str(maker), action=verb, ok=False, reason=str(error))
            self._state.failed(maker, f"{verb} of {maker}: {error}")
            return
        reasons = {"deactivate": "nobody holds it", "clean_up": "it is in error and nobody holds it"}
        if verb != "activate":
            self._journal.append(
                "activation", dfpc=str(maker), action=verb, ok=True, reason=reasons.get(verb, "wanted")
            )
        if verb in reasons:
            self._state.own(maker, owned=False)
        logger.info("%s of %s: done", verb, maker)
        changes = reply.attachment.get("changes")
        self._state.seen_state(maker, state, wired=chosen or None, changes=None if changes is None else int(changes))

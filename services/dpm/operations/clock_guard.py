# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Guard of retention against a mission clock that is lost or has jumped.

Ages of products follow the mission clock. A clock that is lost or wrong would retire products of which the
mission still needs all, therefore retention waits until the clock is confirmed. Only jumps into the future
make products older; after a larger one an operator confirms the time.
"""

from __future__ import annotations

import logging
import threading

from cdff_common.clock import monotonic_s, wall_ns
from cdff_common.errors import StorageError, UnavailableError
from cdff_common.mission_clock import ClockState, MissionClock
from dpm_store import Store
from dpm_store.history.clock_reference import ClockReference
from services.alarms import Alarms, Severity

logger = logging.getLogger(__name__)

#: Largest jump of mission time into the future after which products are retired, seconds.
MAX_JUMP_S = 3600.0
_KIND, _SOURCE = "clock", "dpm"
_CONFIRM = "check the time, then confirm it with `cdff dpm retention --apply --confirm-clock`"
_WRITE_PERIOD_S = 60.0


class ClockGuard:
    """Comparison of the mission clock with its own course and with the last confirmed time in the store.

    A clock other than ``MissionClock`` is set by its owner and always confirmed.
    """

    def __init__(self, store: Store, alarms: Alarms) -> None:
        self._store = store
        self._alarms = alarms
        self._lock = threading.Lock()
        self._reference = store.read_clock_reference()
        self._compared_state: ClockState | None = None
        self._is_vouched_for = False
        self._jump_s = self._before_s = 0.0
        self._written_s = -_WRITE_PERIOD_S

    def update(self) -> str:
        """Compare the clock with its last value; return the reason why nothing may be retired, or an empty
        text.
        """
        clock = self._store.clock
        if not isinstance(clock, MissionClock):
            return ""
        with self._lock:
            reason = self._compare(clock)
            is_due = monotonic_s() - self._written_s >= _WRITE_PERIOD_S
            if (
                not reason and is_due and self._store.statistics().count
            ):  # without products nothing is retired
                self._write(clock)
        if reason:
            remedy = "restart the publisher of the mission clock, or " if "lost" in reason else ""
            self._alarms.set(_KIND, _SOURCE, Severity.WARNING, reason, remedy + _CONFIRM)
        else:
            self._alarms.clear(_KIND, _SOURCE)
        return reason

    def check(self) -> None:
        """Raise UnavailableError if nothing may be retired."""
        reason = self.update()
        if reason:
            raise UnavailableError(f"nothing is retired: {reason}; {_CONFIRM}")

    def confirm(self) -> None:
        """Accept the present mission time as correct."""
        clock = self._store.clock
        if isinstance(clock, MissionClock):
            with self._lock:
                self._compared_state, self._before_s = clock.state, clock.jumped_s
                self._jump_s, self._is_vouched_for = 0.0, True
                self._write(clock)
            self.update()

    def _compare(self, clock: MissionClock) -> str:
        reference, state = self._reference, clock.state
        was_published = reference is not None and reference.is_published
        self._is_vouched_for &= state is not ClockState.RUNNING
        if state is ClockState.LOST and not self._is_vouched_for:
            return "the mission clock is lost, mission time is extrapolated"
        if state is ClockState.WALL and was_published and not self._is_vouched_for:
            return "the mission clock is lost: nothing has published it since the start of the DPM"
        if state is not self._compared_state and reference is not None and not self._is_vouched_for:
            jump_s = reference.jump_s(clock.now_ns(), wall_ns())
        else:
            jump_s = clock.jumped_s - self._before_s
        self._compared_state, self._before_s = state, clock.jumped_s
        self._jump_s = max(self._jump_s + jump_s, 0.0)  # a jump into the past makes nothing older
        if self._jump_s > MAX_JUMP_S:
            return f"mission time jumped by {self._jump_s:.0f} s, expected at most {MAX_JUMP_S:g} s"
        return ""

    def _write(self, clock: MissionClock) -> None:
        is_published = clock.state is not ClockState.WALL
        reference = ClockReference(clock.now_ns(), wall_ns(), clock.rate, is_published)
        try:
            self._store.write_clock_reference(reference)
        except StorageError as error:
            logger.warning("mission time is not noted in the store: %s", error)
            return
        self._reference, self._written_s = reference, monotonic_s()

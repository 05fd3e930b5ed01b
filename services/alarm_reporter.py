# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Publication of the alarms of a process on the bus."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Sequence
from typing import NamedTuple

from cdff_common.bus import Bus, keys
from cdff_common.loops import Loop
from services.alarms import Alarm, Alarms

PERIOD_S = 2.0


class _Change(NamedTuple):
    """Start or end of an alarm."""

    alarm: Alarm | None = None
    is_active: bool = False


_NO_CHANGE = _Change()


class AlarmReporter:
    """Thread that publishes the active alarms periodically, and at once when one begins or ends.

    The start and the end of an alarm are also events ``alarm``, which the DPM adds to the history.

    Parameters
    ----------
    bus : Bus
    scope, service : str
        Owner of the alarms.
    alarms : Alarms
    loop : Loop
        Health of the thread.
    checks : sequence of callable, optional
        Called before each publication; they begin and end alarms.
    """

    def __init__(
        self,
        bus: Bus,
        scope: str,
        service: str,
        alarms: Alarms,
        loop: Loop,
        checks: Sequence[Callable[[], None]] = (),
    ) -> None:
        self._bus, self._scope, self._service = bus, scope, service
        self._alarms, self._checks = alarms, checks
        # Not published by the thread that begins the alarm: a router that hangs would block it.
        self._changes: queue.SimpleQueue[_Change | None] = queue.SimpleQueue()
        alarms.on_change = lambda alarm, is_active: self._changes.put(_Change(alarm, is_active))
        self._thread = threading.Thread(target=loop.run, args=(self._wait, self._work), name="alarms")
        self._thread.daemon = True
        self._thread.start()

    def close(self) -> None:
        """Publish the last changes and end the thread."""
        self._alarms.on_change = None
        self._changes.put(None)
        self._thread.join(PERIOD_S)

    def _wait(self) -> _Change | None:
        try:
            return self._changes.get(timeout=PERIOD_S)
        except queue.Empty:
            return _NO_CHANGE

    def _work(self, change: _Change) -> None:
        if change.alarm is None:
            for check in self._checks:
                check()
        else:
            event = change.alarm.to_event(is_active=change.is_active)
            self._bus.publish_map(keys.event(self._scope, "alarm"), event)
        items = [alarm.to_dict() for alarm in self._alarms.active()]
        self._bus.publish_latched(keys.alarms(self._scope, self._service), {"items": items})

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alarms of a process: conditions that need an operator, active until they end."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from cdff_common.clock import wall_ns

logger = logging.getLogger(__name__)


class Severity(StrEnum):
    """Urgency of an alarm."""

    WARNING = "warning"  # the service works with restrictions
    CRITICAL = "critical"  # data can be lost, or the service does not work


@dataclass(frozen=True, slots=True)
class Alarm:
    """A condition that needs an operator.

    Attributes
    ----------
    kind : str
        Short name, such as ``disk_full``.
    source : str
        Service, robot or product concerned.
    severity : Severity
    since_ns : int
        Start by the wall clock, because the mission clock can be the cause.
    what : str
        Description with values.
    remedy : str
        What the operator does.
    """

    kind: str
    source: str
    severity: Severity
    since_ns: int
    what: str
    remedy: str

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self) | {"severity": str(self.severity)}


class Alarms:
    """Active alarms of a process, one of each kind and source. Thread-safe.

    Attributes
    ----------
    on_change : callable or None
        Called with each alarm that begins or ends, and whether it is active.
    """

    def __init__(self, on_change: Callable[[Alarm, bool], None] | None = None) -> None:
        self.on_change = on_change
        self._lock = threading.Lock()
        self._active: dict[tuple[str, str], Alarm] = {}

    def set(self, kind: str, source: str, severity: Severity, what: str, remedy: str) -> None:
        """Begin an alarm, or replace the description of an active one."""
        with self._lock:
            active = self._active.get((kind, source))
            since_ns = wall_ns() if active is None else active.since_ns
            alarm = self._active[kind, source] = Alarm(kind, source, severity, since_ns, what, remedy)
        if active is None:
            logger.error("alarm %s of %s: %s; %s", kind, source, what, remedy)
            if self.on_change is not None:
                self.on_change(alarm, True)

    def clear(self, kind: str, source: str) -> None:
        """End an alarm if it is active."""
        with self._lock:
            alarm = self._active.pop((kind, source), None)
        if alarm is not None:
            logger.info("alarm %s of %s has ended", kind, source)
            if self.on_change is not None:
                self.on_change(alarm, False)

    def active(self) -> list[Alarm]:
        """Return the active alarms, oldest first."""
        with self._lock:
            return sorted(self._active.values(), key=lambda alarm: alarm.since_ns)

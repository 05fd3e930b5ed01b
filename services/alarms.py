# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alarms of a process: conditions that need an operator, active until they end."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from typing import Any, Self

from cdff_common.clock import wall_ns
from cdff_common.errors import CodecError

logger = logging.getLogger(__name__)

#: Largest number of characters of a text of an alarm.
_MAX_TEXT = 2000


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

    def to_event(self, *, is_active: bool) -> dict[str, Any]:
        """Return the body of the event of its start or end; ``kind`` is that of the event in the history."""
        return self.to_dict() | {"alarm": self.kind, "active": is_active}

    @classmethod
    def parse(cls, body: object) -> Self:
        """Return the alarm of plain data from the bus; raises CodecError."""
        if not isinstance(body, dict) or set(body) != {field.name for field in fields(cls)}:
            raise CodecError(f"alarm {str(body)[:80]}: expected the fields of an alarm")
        texts = [body[name] for name in ("kind", "source", "what", "remedy")]
        if not all(isinstance(text, str) and len(text) <= _MAX_TEXT for text in texts):
            raise CodecError(f"alarm {str(body)[:80]}: expected texts of at most {_MAX_TEXT} characters")
        if body["severity"] not in set(Severity) or not isinstance(body["since_ns"], int):
            raise CodecError(f"alarm {str(body)[:80]}: expected a severity and integer nanoseconds")
        return cls(**body | {"severity": Severity(body["severity"])})


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

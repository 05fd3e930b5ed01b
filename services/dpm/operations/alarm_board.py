# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Active alarms of all services, with their acknowledgements.

An acknowledgement states which operator has noticed an alarm. It is kept in the store, over restarts of the
DPM and of the source, until the alarm has not been active for ``KEPT_S``.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from cdff_common.clock import monotonic_s, wall_ns
from cdff_common.errors import CodecError, ProductNotFoundError, StorageError
from dpm_store import Event, Store
from dpm_store.history.events import actor
from services.alarms import Alarm, Alarms

logger = logging.getLogger(__name__)

_NOTE = "alarm_acknowledgements"
#: Age at which the report of a service no longer counts, seconds.
_SILENCE_S = 10.0
#: Time for which an acknowledgement outlives its alarm, seconds.
KEPT_S = 120.0
#: Largest number of alarms of one service.
_MAX_ALARMS = 100

Key = tuple[str, str]


@dataclass(frozen=True, slots=True)
class Acknowledgement:
    """Operator who has noticed an alarm, and the time by the wall clock."""

    acknowledged_by: str
    acknowledged_ns: int


_NONE = {"acknowledged_by": None, "acknowledged_ns": None}


class AlarmBoard:
    """The alarms of the DPM and those that other services report.

    Parameters
    ----------
    alarms : Alarms
        Alarms of the DPM.
    store : Store
        Keeps the acknowledgements.
    now_s : callable, optional
        Monotonic seconds.
    """

    def __init__(self, alarms: Alarms, store: Store, now_s: Callable[[], float] = monotonic_s) -> None:
        self._alarms, self._store, self._now_s = alarms, store, now_s
        self._lock = threading.Lock()
        self._reports: dict[Key, tuple[float, list[Alarm]]] = {}
        self._acknowledged: dict[Key, Acknowledgement] = {
            (entry["kind"], entry["source"]): Acknowledgement(entry["by"], entry["at_ns"])
            for entry in store.read_note(_NOTE) or ()
        }
        self._seen_s = dict.fromkeys(self._acknowledged, now_s())

    def report(self, scope: str, service: str, items: object) -> None:
        """Replace the alarms of another service; raises CodecError."""
        if not isinstance(items, list) or len(items) > _MAX_ALARMS:
            raise CodecError(f"alarms of {scope}/{service}: expected a list of at most {_MAX_ALARMS}")
        alarms = [Alarm.parse(item) for item in items]
        now_s = self._now_s()
        with self._lock:
            fresh = {key: report for key, report in self._reports.items() if report[0] >= now_s - _SILENCE_S}
            self._reports = fresh | {(scope, service): (now_s, alarms)}

    def follow(self, event: Event) -> None:
        """Adopt an acknowledgement that another process of the same store has entered in the history."""
        name, at_ns = event.body.get("acknowledged_by"), event.body.get("acknowledged_ns")
        if event.kind == "alarm" and isinstance(name, str) and isinstance(at_ns, int):
            with self._lock:
                key = str(event.body.get("alarm")), str(event.body.get("source"))
                self._acknowledged.setdefault(key, Acknowledgement(name, at_ns))
                self._seen_s[key] = self._now_s()

    def active(self) -> list[dict[str, Any]]:
        """Return the active alarms as plain data with their acknowledgements, oldest first."""
        with self._lock:
            items = []
            for key, alarm in sorted(self._by_key().items(), key=lambda item: item[1].since_ns):
                acknowledgement = self._acknowledged.get(key)
                items.append(
                    alarm.to_dict() | (_NONE if acknowledgement is None else asdict(acknowledgement))
                )
            return items

    def acknowledge(self, kind: str, source: str) -> dict[str, Any]:
        """Acknowledge an active alarm as the present actor and return it.

        Raises
        ------
        ProductNotFoundError
            If the alarm is not active.
        """
        key, who = (kind, source), actor()
        with self._lock:
            alarm = self._by_key().get(key)
            if alarm is None:
                raise ProductNotFoundError(f"no alarm {kind[:64]!r} of {source[:64]!r} is active")
            name = "local" if who is None else who.text
            acknowledgement = self._acknowledged.setdefault(key, Acknowledgement(name, wall_ns()))
            self._seen_s[key] = self._now_s()
            self._write()
        return alarm.to_dict() | asdict(acknowledgement)

    def drop_old_acknowledgements(self) -> None:
        """Remove the acknowledgements of alarms that ended a while ago."""
        with self._lock:
            now_s, active = self._now_s(), self._by_key()
            self._seen_s |= dict.fromkeys(self._acknowledged.keys() & active.keys(), now_s)
            ended = [key for key, seen_s in self._seen_s.items() if now_s - seen_s > KEPT_S]
            for key in ended:
                del self._acknowledged[key], self._seen_s[key]
            if ended:
                self._write()

    def _by_key(self) -> dict[Key, Alarm]:
        """Return the active alarms by kind and source; those of the DPM itself are the newest."""
        oldest_s = self._now_s() - _SILENCE_S
        reported = [alarms for at_s, alarms in self._reports.values() if at_s >= oldest_s]
        alarms = [alarm for group in (*reported, self._alarms.active()) for alarm in group]
        return {(alarm.kind, alarm.source): alarm for alarm in alarms}

    def _write(self) -> None:
        entries = [
            {"kind": kind, "source": source, "by": entry.acknowledged_by, "at_ns": entry.acknowledged_ns}
            for (kind, source), entry in self._acknowledged.items()
        ]
        try:
            self._store.write_note(_NOTE, entries)
        except StorageError as error:  # the alarm to acknowledge can be that of the disk
            logger.warning("acknowledgements are lost with the next restart: %s", error)

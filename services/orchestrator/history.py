# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Forwarding of the journal to the history of the DPM: requests, decisions, activations, mode changes."""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping
from typing import Any

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import pack
from cdff_common.errors import CdffError, CodecError, InputError, UnavailableError
from cdff_common.loops import Loops
from services.orchestrator.journal import Journal
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)

#: Largest number of records in a call, and the time to wait for more before a call, seconds.
_BATCH, _COLLECT_S = 200, 0.2
#: First and longest wait after a failed call, seconds.
_RETRY_S, _RETRY_MAX_S = 0.5, 10.0
_TIMEOUT_S = 5.0


def history_origin(scope: str) -> str:
    """Return the name of the journal of an orchestrator in the history: its scope, or its first robot."""
    return f"orchestrator/{scope}"


class HistoryForwarder:
    """Thread that sends the records in order, and continues after a restart from the last acknowledged entry.

    Records wait in the journal while the DPM is unreachable. Each is sent until acknowledged; the DPM ignores
    repeated ones.

    Parameters
    ----------
    bus : Bus
    journal : Journal
    origin : str
        Name of this journal in the history.
    timing : Timing, optional
    scope : str
        Scope under which the identity of this process may call the DPM; default: ground.
    """

    def __init__(
        self,
        bus: Bus,
        journal: Journal,
        origin: str,
        loops: Loops,
        timing: Timing = REAL,
        scope: str = keys.GROUND,
    ) -> None:
        self._bus, self._scope = bus, scope
        self._journal = journal
        self._origin = origin
        self._timing = timing
        self._stop, self._new_records = timing.event(), timing.event()
        self._loop = loops.add("history")  # sending lasts as long as the DPM is unreachable
        self._acknowledged = 0
        self._offset: int | None = None  # end of the last sent record; None before the first cycle
        self._thread: threading.Thread | None = None
        journal.listen(lambda _record: self._new_records.set())

    def start(self) -> None:
        """Start the thread."""
        self._thread = self._timing.start(self._run, "history")

    def close(self) -> None:
        """Stop; the next process sends the remaining records."""
        self._stop.set()
        self._new_records.set()
        if self._thread is not None:
            self._thread.join(timeout=2.0)

    def _run(self) -> None:
        self._loop.run(self._wait, self._forward)

    def _wait(self) -> bool | None:
        """Wait for new records; return None once stopped."""
        if self._offset is not None:
            self._new_records.wait()
            self._stop.wait(_COLLECT_S)
        return None if self._stop.is_set() else True

    def _forward(self, _: object) -> None:
        """Send the records since the last cycle; in the first cycle those not acknowledged before."""
        self._new_records.clear()
        batch: list[dict[str, Any]] = []
        offset = self._offset or 0
        if self._offset is None:
            self._send([])  # reads the last acknowledged number
            for record in self._journal.archived():
                batch = self._add(batch, record)
        for record, end in self._journal.records_from(offset):
            batch = self._add(batch, record)
            offset = end
        if batch:
            self._send(batch)
        self._offset = offset  # after an error, the next cycle reads the same records again

    def _add(self, batch: list[dict[str, Any]], record: Mapping[str, Any]) -> list[dict[str, Any]]:
        if int(record["n"]) <= (batch[-1]["number"] if batch else self._acknowledged):
            return batch
        batch.append(entry_of(record))
        if len(batch) < _BATCH:
            return batch
        self._send(batch)
        return []

    def _send(self, batch: list[dict[str, Any]]) -> None:
        """Send until acknowledged or stopped."""
        wait_s = _RETRY_S
        while not self._stop.is_set():
            try:
                self._acknowledged = self._call(batch)
                return
            except InputError as error:
                if len(batch) > 1:  # a refused record must not block the others
                    for entry in batch:
                        self._send([entry])
                else:
                    logger.warning("a record of the journal is refused by the history: %s", error)
                return
            except CdffError as error:
                logger.debug("the history is not reachable: %s", error)
                self._stop.wait(wait_s)
                wait_s = min(2.0 * wait_s, _RETRY_MAX_S)

    def _call(self, batch: list[dict[str, Any]]) -> int:
        """Send entries; return the number of the last acknowledged entry."""
        body = pack({"origin": self._origin, "entries": batch})
        reply = self._bus.call(keys.dpm_rpc(self._scope, "history"), payload=body, timeout_s=_TIMEOUT_S)
        try:
            return int(reply.body()["last"])
        except (CodecError, KeyError, TypeError, ValueError) as error:
            raise UnavailableError(f"malformed answer of the history: {error}") from error


def entry_of(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the history entry for a record."""
    subject = str(record.get("dfpc") or record.get("sensor") or "")
    robot = subject.partition("/")[0] or str(record.get("robot", "any"))
    body = {name: value for name, value in record.items() if name not in ("n", "stamp_ns", "kind")}
    return {
        "number": int(record["n"]),
        "stamp_ns": int(record["stamp_ns"]),
        "scope": keys.GROUND if robot == "any" else robot,
        "kind": str(record["kind"]),
        "body": body,
    }

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Forwards the journal to the DPM's history: every request, decision, activation and mode change, with its reason."""

from __future__ import annotations

import logging
import threading
from collections.abc import Mapping
from typing import Any

from cdff_common.bus import Bus, keys
from cdff_common.bus.message import pack
from cdff_common.errors import CdffError, InputError
from services.orchestrator.journal import Journal
from services.orchestrator.timing import REAL, Timing

logger = logging.getLogger(__name__)

#: Most records of one call, and for how long more are waited for before it, seconds.
_BATCH, _GATHER_S = 200, 0.2
#: Waits after a call that failed, seconds: the first one, and the longest.
_RETRY_S, _RETRY_MOST_S = 0.5, 10.0
_TIMEOUT_S = 5.0


class HistoryForwarder:
    """A thread that sends what the journal holds, in order, and goes on after restarts where the DPM had got to.

    While the DPM is away the records wait in the journal. Each is sent until the DPM says that it is kept, and the DPM
    keeps each once.

    Parameters
    ----------
    bus : Bus
    journal : Journal
    origin : str
        Name of this journal in the history: one for each set of robots.
    timing : Timing, optional
    """

    def __init__(self, bus: Bus, journal: Journal, origin: str, timing: Timing = REAL) -> None:
        self._bus = bus
        self._journal = journal
        self._origin = origin
        self._timing = timing
        self._stop, self._grown = timing.event(), timing.event()
        self._kept = 0
        self._thread: threading.Thread | None = None
        journal.listen(lambda _record: self._grown.set())

    def start(self) -> None:
        """Begin."""
        self._thread = self._timing.start(self._run, "history")

    def close(self) -> None:
        """Stop; what was not sent is sent by the next one."""
        self._stop.set()
        self._grown.set()
        if self._thread is not None:
            self._thread.join(timeout=2.0)

    def _run(self) -> None:
        self._send([])  # asks how far the DPM has got
        batch: list[dict[str, Any]] = []
        for record in self._journal.put_aside():
            batch = self._add(batch, record)
        offset = 0
        while not self._stop.is_set():
            self._grown.clear()
            for record, end in self._journal.records_from(offset):
                batch = self._add(batch, record)
                offset = end
            if batch:
                self._send(batch)
                batch = []
            self._grown.wait()
            self._stop.wait(_GATHER_S)

    def _add(self, batch: list[dict[str, Any]], record: Mapping[str, Any]) -> list[dict[str, Any]]:
        if int(record.get("n", 0)) <= (batch[-1]["number"] if batch else self._kept):
            return batch
        batch.append(entry_of(record))
        if len(batch) < _BATCH:
            return batch
        self._send(batch)
        return []

    def _send(self, batch: list[dict[str, Any]]) -> None:
        """Send until it is kept, or until the end."""
        wait_s = _RETRY_S
        while not self._stop.is_set():
            try:
                self._kept = self._call(batch)
                return
            except InputError as error:
                if len(batch) > 1:  # one record that cannot be kept must not hold up the others
                    for one in batch:
                        self._send([one])
                else:
                    logger.warning("a record of the journal is not kept in the history: %s", error)
                return
            except CdffError as error:
                logger.debug("the history waits: %s", error)
                self._stop.wait(wait_s)
                wait_s = min(2.0 * wait_s, _RETRY_MOST_S)

    def _call(self, batch: list[dict[str, Any]]) -> int:
        """Have entries kept; the number of the last one that is."""
        body = pack({"origin": self._origin, "entries": batch})
        return int(
            self._bus.call(keys.dpm_rpc(keys.GROUND, "history"), payload=body, timeout_s=_TIMEOUT_S).body()["last"]
        )


def entry_of(record: Mapping[str, Any]) -> dict[str, Any]:
    """What the DPM takes of a record: its robot is the scope, its kind the kind."""
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

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Log of refused writes in the history. Events of accepted writes state the caller in ``by``.

The number of entries of a caller per minute is limited; the others are counted in the next entry. Callers
without a known key share one name.
"""

from __future__ import annotations

import logging
import threading
from dataclasses import dataclass, field

from cdff_common.clock import monotonic_s
from cdff_common.errors import CdffError
from dpm_store.history.events import Actor
from services.dpm.operations.dpm import Dpm

logger = logging.getLogger(__name__)

_WINDOW_S = 60.0
_PER_WINDOW = {"unknown": 1}
_PER_WINDOW_KNOWN = 60


@dataclass
class _Window:
    start_s: float
    count: int = 0
    left_out: int = field(default=0)


class RefusalLog:
    """Adds refused writes to the history of a DPM."""

    def __init__(self, dpm: Dpm) -> None:
        self._dpm = dpm
        self._lock = threading.Lock()
        self._windows: dict[str, _Window] = {}
        self.identity_alarm = dpm.identity_alarm

    def enter(
        self, actor: Actor | None, what: str, status: int | str, reason: str, address: str = ""
    ) -> None:
        """Add one refusal, or count it.

        Parameters
        ----------
        actor : Actor or None
            None for a key that is not known.
        what : str
            Operation, e.g. ``DELETE /api/v1/products/…`` or ``dpm/@rpc/delete``.
        status : int or str
            HTTP status or RPC code.
        reason : str
            The message to the caller; never a key.
        """
        who = "unknown" if actor is None else actor.text
        left_out = self._omitted_before(who)
        if left_out is None:
            return
        body = {
            "by": who,
            "what": what[:200],
            "status": status,
            "reason": reason[:400],
            "address": address[:64],
            "left_out": left_out,
        }
        logger.warning(
            "refused: %s by %s: %s (%d more since the last entry)", what[:200], who, reason[:200], left_out
        )
        scope = actor.name if actor is not None and actor.role == "robot" else "ground"
        try:
            self._dpm.writer.record(scope, "refused", body)
        except CdffError as error:  # a full disk must not turn a 403 into a 507
            logger.error("refusal not entered in the history: %s", error)

    def _omitted_before(self, who: str) -> int | None:
        """Return the number of omitted entries before this one; None if this one is also omitted."""
        now_s = monotonic_s()
        with self._lock:
            window = self._windows.get(who)
            if window is None or now_s - window.start_s > _WINDOW_S:
                left_out = 0 if window is None else window.left_out
                self._windows[who] = _Window(now_s, 1)
                return left_out
            if window.count >= _PER_WINDOW.get(who, _PER_WINDOW_KNOWN):
                window.left_out += 1
                return None
            window.count += 1
            left_out, window.left_out = window.left_out, 0
            return left_out

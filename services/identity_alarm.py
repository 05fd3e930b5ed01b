# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alarm of refused identities: callers without a valid key or certificate, or beyond their rights."""

from __future__ import annotations

import threading

from cdff_common.clock import monotonic_s
from services.alarms import Alarms, Severity

_KIND = "refused_identity"
#: Time without a refusal after which the alarm ends, seconds.
QUIET_S = 600.0


class IdentityAlarm:
    """Alarm of one entrance, such as ``http`` or ``router``; it ends after ``QUIET_S`` without a refusal."""

    def __init__(self, alarms: Alarms, source: str) -> None:
        self._alarms, self._source = alarms, source
        self._lock = threading.Lock()
        self._count, self._last_s = 0, 0.0

    def refuse(self, refusal: str, count: int = 1) -> None:
        """Begin the alarm, or count further refusals; ``refusal`` names the caller and the reason."""
        with self._lock:
            self._count, self._last_s = self._count + count, monotonic_s()
            text = f"{self._count} refused, the last one: {refusal[:400]}"
        remedy = "find the caller; if it is not yours, revoke its key or certificate (cdff keys revoke)"
        self._alarms.set(_KIND, self._source, Severity.WARNING, text, remedy)

    def update(self) -> None:
        """End the alarm if it has been quiet; to be called periodically."""
        with self._lock:
            if not self._count or monotonic_s() - self._last_s < QUIET_S:
                return
            self._count = 0
        self._alarms.clear(_KIND, self._source)

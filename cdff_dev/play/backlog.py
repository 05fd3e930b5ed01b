# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lag of the DFPCs behind the mission clock, from their status."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

from cdff_common.clock import NS_PER_S, monotonic_s

#: A DFPC without a status for this long has ended or hangs and is not waited for, seconds.
_SILENT_S = 15.0


class Backlog:
    """The oldest sample that each DFPC has not finished with."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._oldest: dict[str, tuple[int, float]] = {}

    def on_status(self, key: str, status: Mapping[str, Any]) -> None:
        """Take the status of a DFPC by its key; one that does not run is not waited for."""
        oldest_ns = status.get("oldest_ns")
        with self._lock:
            if status.get("state") == "active" and isinstance(oldest_ns, int):
                self._oldest[key] = (oldest_ns, monotonic_s())
            else:
                self._oldest.pop(key, None)

    def lag_s(self, now_ns: int) -> float:
        """Return the lag of the oldest waiting sample, seconds of mission time; 0 if nothing waits."""
        since_s = monotonic_s() - _SILENT_S
        with self._lock:
            stamps = [oldest_ns for oldest_ns, heard_s in self._oldest.values() if heard_s > since_s]
        return max((now_ns - min(stamps)) / NS_PER_S, 0.0) if stamps else 0.0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lag of the DFPCs behind the mission clock, from their status."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

from cdff_common.clock import NS_PER_S, monotonic_s

#: Time without a status after which a DFPC is ignored, seconds: it has ended or hangs.
_STATUS_TIMEOUT_S = 15.0


class Backlog:
    """Lag of the DFPCs: the stamp of the oldest unprocessed sample of each."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        # By status key: stamp of the oldest unprocessed sample, and monotonic time of the status.
        self._oldest: dict[str, tuple[int, float]] = {}

    def on_status(self, key: str, status: Mapping[str, Any]) -> None:
        """Store the status of a DFPC by its key; an inactive DFPC has no lag."""
        oldest_ns = status.get("oldest_ns")
        with self._lock:
            if status.get("state") == "active" and isinstance(oldest_ns, int):
                self._oldest[key] = (oldest_ns, monotonic_s())
            else:
                self._oldest.pop(key, None)

    def lag_s(self, now_ns: int) -> float:
        """Return the lag of the oldest unprocessed sample, mission seconds; 0 if there is none."""
        oldest_status_s = monotonic_s() - _STATUS_TIMEOUT_S
        with self._lock:
            stamps = [
                oldest_ns for oldest_ns, status_s in self._oldest.values() if status_s > oldest_status_s
            ]
        return max((now_ns - min(stamps)) / NS_PER_S, 0.0) if stamps else 0.0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Counters of requests and actions, derived from the records of the journal."""

from __future__ import annotations

import threading
from bisect import bisect_left
from collections import Counter
from collections.abc import Mapping
from typing import Any

from cdff_core.orchestration.lifecycle import FINAL_STATES

#: Upper edges of the histogram of reply times, seconds; the last bucket has no upper edge.
REPLY_EDGES_S = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0)


class Metrics:
    """Thread-safe counters since the start of the process."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._open: dict[str, tuple[str, int]] = {}
        self._requests: Counter[tuple[str, str]] = Counter()
        self._actions: Counter[tuple[str, bool]] = Counter()
        self._reply_counts = [0] * (len(REPLY_EDGES_S) + 1)
        self._reply_sum_s = 0.0

    def on_record(self, record: Mapping[str, Any]) -> None:
        """Count one record."""
        with self._lock:
            if record["kind"] == "job":
                self._on_job(record)
            elif record["kind"] == "activation":
                self._actions[str(record["action"]), bool(record["ok"])] += 1
            elif record["kind"] == "mode":
                self._actions["set_mode", bool(record["ok"])] += 1

    def _on_job(self, record: Mapping[str, Any]) -> None:
        job, state = str(record["job"]), record["state"]
        if "request" in record:
            self._open[job] = (str(record["request"]["type"]), int(record["at_ns"]))
        elif state in FINAL_STATES and job in self._open:
            product, since_ns = self._open.pop(job)
            reply_s = (int(record["at_ns"]) - since_ns) * 1e-9
            self._requests[product, str(state)] += 1
            self._reply_counts[bisect_left(REPLY_EDGES_S, reply_s)] += 1
            self._reply_sum_s += reply_s

    def to_dict(self) -> dict[str, Any]:
        """Return ``open``, ``requests`` by type and final state, ``actions`` by verb, ``answers`` by reply
        time.
        """
        with self._lock:
            return {
                "open": len(self._open),
                "requests": [
                    {"type": p, "state": s, "count": n} for (p, s), n in sorted(self._requests.items())
                ],
                "actions": [
                    {"verb": v, "ok": ok, "count": n} for (v, ok), n in sorted(self._actions.items())
                ],
                "answers": {
                    "edges_s": list(REPLY_EDGES_S),
                    "counts": list(self._reply_counts),
                    "sum_s": self._reply_sum_s,
                },
            }

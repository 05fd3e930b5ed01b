# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A run of the chaos suite: mission, traffic, disturbances, and the assessment by the oracle."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.chaos.mission import Mission, wait_until
from tests.chaos.oracle import Oracle, Stored, memory_limit_mb
from tests.chaos.schedule import disturb
from tests.chaos.traffic import Traffic

#: Time for the outboxes to be empty after the last disturbance, seconds.
_DELIVERED_S = 120.0
#: Time in which services load their codecs at the start, and return memory at the end, seconds.
_SETTLED_S = 15.0
_PAGE = 1000


class ResourceUse:
    """Memory, descriptors and threads of each service, sampled in a thread."""

    def __init__(self, mission: Mission) -> None:
        self._samples: dict[str, list[tuple[float, ...]]] = {}
        self._mission, self._stop = mission, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        start_s = time.monotonic()
        while not self._stop.wait(2.0):
            for name, resources in self._mission.resources().items():
                self._samples.setdefault(name, []).append((time.monotonic() - start_s, *resources))

    def stop(self) -> None:
        """End the thread."""
        self._stop.set()
        self._thread.join()

    def peak_mb(self, name: str) -> float:
        """Return the largest memory of a service."""
        return max(sample[1] for sample in self._samples[name])

    def slopes_per_hour(self, name: str) -> dict[str, float]:
        """Return the slopes of straight lines through the second half of the samples, over all restarts."""
        samples = np.array(self._samples[name])
        half = samples[len(samples) // 2 :]
        slopes = np.polyfit(half[:, 0] / 3600.0, half[:, 1:], 1)[0]
        return {
            quantity: round(float(slope), 1)
            for quantity, slope in zip(("memory_mb", "descriptors", "threads"), slopes, strict=True)
        }


def run(folder: Path, minutes: float, seed: int) -> dict[str, Any]:
    """Run a mission with disturbances in a folder and return the summary."""
    oracle, started_s = Oracle(), time.monotonic()
    with Mission(folder) as mission:
        traffic = Traffic(mission, oracle, seed)
        time.sleep(_SETTLED_S)
        before_mb, resource_use = mission.memory_mb(), ResourceUse(mission)
        counts = disturb(mission, oracle, minutes, seed)
        traffic.stop()
        if not mission.wait_ready():
            oracle.violate("at the end: not ready")
        if not wait_until(lambda: not _missing(mission, oracle), _DELIVERED_S):
            oracle.violate(f"at the end: products not delivered within {_DELIVERED_S:g} s")
        time.sleep(_SETTLED_S)
        resource_use.stop()
        after_mb = mission.memory_mb()
        oracle.check_products(stored_products(mission))
        oracle.check_requests()
        oracle.check_memory(before_mb, after_mb)
    memory_mb = {
        name: {
            "before": before_mb[name],
            "peak": resource_use.peak_mb(name),
            "after": after_mb[name],
            "limit": round(memory_limit_mb(name, before_mb[name])),
            "slopes_per_hour": resource_use.slopes_per_hour(name),
        }
        for name in after_mb
    }
    return {
        "minutes": minutes,
        "seed": seed,
        "seconds": round(time.monotonic() - started_s),
        "disturbances": counts,
        "memory_mb": memory_mb,
        **oracle.summary(),
    }


def stored_products(mission: Mission) -> list[Stored]:
    """Return all products in the DPM."""
    result: list[Stored] = []
    parameters: dict[str, object] = {"limit": _PAGE}
    while True:
        page = mission.call("search", **parameters)
        result += [Stored(i["id"], i["robot"], i["dfpc"], i["port"], int(i["t1_ns"])) for i in page["items"]]
        if not page.get("cursor"):
            return result
        parameters["cursor"] = page["cursor"]


def _missing(mission: Mission, oracle: Oracle) -> set[str]:
    return oracle.promised() - {product.id for product in stored_products(mission)}

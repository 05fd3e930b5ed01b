# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Random sequences of disturbances: two lanes, each with its own random numbers from the seed."""

from __future__ import annotations

import random
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor

from tests.chaos.disturbances.disturbance import Disturbance, Scene
from tests.chaos.disturbances.table import faults, strangers
from tests.chaos.mission import Mission
from tests.chaos.oracle import Oracle

#: Time for the services to be ready after a fault, seconds.
RECOVERY_S = 120.0


def disturb(mission: Mission, oracle: Oracle, minutes: float, seed: int) -> dict[str, int]:
    """Run both lanes for the given time; return how often each disturbance took place."""
    counts: Counter[str] = Counter()
    until_s = time.monotonic() + 60.0 * minutes

    def run(name: str, lane: Sequence[Disturbance], recovers: bool) -> None:
        scene = Scene(mission, oracle, random.Random(f"{seed}/{name}"))
        for disturbance in _sequence(lane, mission, scene.rng):
            left_s = until_s - time.monotonic()
            if left_s <= min(d.longest_s for d in lane):
                return
            if left_s <= disturbance.longest_s:
                continue
            sys.stderr.write(f"chaos: {left_s:6.1f} s left: {disturbance.name}\n")
            disturbance.run(scene)
            counts[disturbance.name] += 1
            if recovers and not mission.wait_ready(RECOVERY_S):
                oracle.violate(f"after {disturbance.name}: not ready within {RECOVERY_S:g} s")
            time.sleep(scene.rng.uniform(0.5, 3.0))

    with ThreadPoolExecutor() as pool:
        lanes = [
            pool.submit(run, "faults", faults(), True),
            pool.submit(run, "strangers", strangers(), False),
        ]
    for lane in lanes:
        error = lane.exception()
        if error is not None:
            oracle.violate(f"a disturbance failed: {error!r}")
    return dict(sorted(counts.items()))


def _sequence(lane: Sequence[Disturbance], mission: Mission, rng: random.Random) -> Iterator[Disturbance]:
    """Yield disturbances without end: each once in random order, then all again in another order."""
    possible = [disturbance for disturbance in lane if disturbance.is_possible(mission)]
    while True:
        rng.shuffle(possible)
        yield from possible

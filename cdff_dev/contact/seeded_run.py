# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One exchange over a lossy link with a full window, killed processes and an outage, drawn from a seed."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cdff_dev.contact.simulated_link import Direction
from cdff_dev.contact.two_stores import GROUND_SIDE, ROBOT_SIDE, TwoStores

#: Loss of both directions, and the rate from the robot, bit/s; the other direction has a fifth.
LOSS, RATE_BIT_S = 0.02, 1e6
_UP_SHARE = 0.2
#: Duration of the first window and of the pause after it, seconds; the second window completes the exchange.
WINDOW_S, PAUSE_S = 30.0, 3.0
#: Order of the generated products: poses are urgent, maps are small.
PRIORITIES = {"pose": 0, "dem": 1, "pointcloud": 2}
#: Products of the generated cycle: 20 poses, a map and a cloud, 0.64 MB.
CYCLE = 22
_LAST_WINDOW_S, _LIMIT_S = 600.0, 120.0
#: Time until the ground has noted all received bytes, seconds.
_NOTED_S = 0.7


@dataclass(frozen=True, slots=True)
class RunResult:
    """Figures of one run.

    Attributes
    ----------
    seed : int
    delay_s : float
        One-way delay.
    killed : tuple of str
        Processes that were killed with SIGKILL in the window, in order.
    products : int
    lost, wrong, twice : int
        Products that are not at the ground, that differ from those of the robot, and that were stored twice.
    out_s : float
        Time of the first window in which the link did not exist or a killed process did not run, seconds.
    used : float
        Bytes of records and payloads at the ground from the first window, divided by those that the link can
        carry in the rest of the window.
    used_of_all : float
        The same bytes, divided by those that the link can carry in the whole window.
    resent : float
        Fraction of the sent item bytes that were sent before.
    disordered : int
        Products that were stored at the ground before one of a higher priority.
    """

    seed: int
    delay_s: float
    killed: tuple[str, ...]
    products: int
    lost: int
    wrong: int
    twice: int
    out_s: float
    used: float
    used_of_all: float
    resent: float
    disordered: int

    def to_dict(self) -> dict[str, Any]:
        """Return plain data with rounded fractions."""
        names = ("delay_s", "out_s", "used", "used_of_all", "resent")
        rounded = {name: round(getattr(self, name), 3) for name in names}
        return asdict(self) | rounded | {"killed": list(self.killed)}


def seeded_run(
    folder: Path,
    seed: int,
    kills: int = 2,
    cycles: int = 7,
    window_s: float = WINDOW_S,
    loss: float = LOSS,
    delay_s: float | None = None,
) -> RunResult:
    """Exchange generated products once, and return the figures.

    Parameters
    ----------
    folder : Path
        Empty folder.
    seed : int
        Of the products, the delay, the loss, the kills and the outage.
    kills : int
        Number of kills in the first window; 0 for neither kills nor an outage.
    cycles : int
        Cycles of products; seven fill a window of 30 s.
    window_s : float
        Duration of the first window.
    loss : float
        Fraction of the datagrams that are lost.
    delay_s : float, optional
        One-way delay; drawn from the seed if it is not given.

    Raises
    ------
    DeadlineError
        If the exchange does not end in time.
    """
    random_ = random.Random(seed)
    drawn_s = random_.uniform(0.01, 0.5)
    delay_s = drawn_s if delay_s is None else delay_s
    down = Direction(RATE_BIT_S, delay_s, loss)
    up = Direction(_UP_SHARE * RATE_BIT_S, delay_s, loss)
    windows_s = [(0.0, window_s), (window_s + PAUSE_S, window_s + PAUSE_S + _LAST_WINDOW_S)]
    sides = [random_.choice((ROBOT_SIDE, GROUND_SIDE)) for _ in range(kills)]
    times_s = sorted(random_.uniform(0.1, 0.7) * window_s for _ in range(kills))
    sent_bytes, out_s = 0, 0.0
    with TwoStores(folder, windows_s, down, up, seed) as both:
        both.start(ROBOT_SIDE, GROUND_SIDE)
        both.call(ROBOT_SIDE, "put", seed=seed, numbers=list(range(cycles * CYCLE)))
        both.begin(lead_s=1.0)
        for side, time_s in zip(sides, times_s, strict=True):
            _wait_until(both, time_s)
            sent_bytes += both.call(ROBOT_SIDE, "status")["bytes_sent"] if side == ROBOT_SIDE else 0
            out_s += _kill_and_restart(both, side, window_s)
        if kills and both.now_s < window_s - 2.0:
            out_s += _interrupt(both, random_.uniform(0.3, 1.5))
        _wait_until(both, window_s + delay_s + _NOTED_S)
        link_bytes, out_s = RATE_BIT_S / 8.0 * window_s, min(out_s, 0.99 * window_s)
        used = both.call(GROUND_SIDE, "received_bytes") / link_bytes
        both.wait_for(lambda: _is_complete(both), _LIMIT_S, "the end of the exchange")
        sent_bytes += both.call(ROBOT_SIDE, "status")["bytes_sent"]
        sent, arrived = (both.call(side, "digests") for side in (ROBOT_SIDE, GROUND_SIDE))
        item_bytes = both.call(ROBOT_SIDE, "item_bytes")
        return RunResult(
            seed,
            delay_s,
            tuple(sides),
            len(sent),
            lost=len(sent.keys() - arrived.keys()),
            wrong=sum(sent.get(key) != digest for key, digest in arrived.items()),
            twice=both.call(GROUND_SIDE, "insertions") - len(arrived),
            out_s=out_s,
            used=used / (1.0 - out_s / window_s),
            used_of_all=used,
            resent=max(1.0 - item_bytes / sent_bytes, 0.0),
            disordered=_disordered(both.call(GROUND_SIDE, "types")),
        )


def _disordered(types: Sequence[str]) -> int:
    """Return how many products precede one of a higher priority."""
    priorities = [PRIORITIES[kind] for kind in types]
    return sum(min(priorities[n:]) < priority for n, priority in enumerate(priorities))


def _wait_until(both: TwoStores, time_s: float) -> None:
    both.wait_for(lambda: both.now_s >= time_s, _LIMIT_S, f"second {time_s:.1f} of the plan")


def _kill_and_restart(both: TwoStores, side: str, window_s: float) -> float:
    """Kill a process and start it again; return the time of the window for which it did not run, seconds."""
    start_s = both.now_s
    both.kill(side)
    both.restart(side)
    return min(both.now_s, window_s) - min(start_s, window_s)


def _interrupt(both: TwoStores, duration_s: float) -> float:
    """Interrupt the link; return the duration of the interruption, seconds."""
    start_s = both.now_s
    both.link.cut()
    _wait_until(both, start_s + duration_s)
    both.link.restore()
    return both.now_s - start_s


def _is_complete(both: TwoStores) -> bool:
    """Return whether the ground has all products, and the robot has their acknowledgements."""
    if both.call(ROBOT_SIDE, "status")["backlog"]:
        return False
    counts = [both.call(side, "insertions") for side in (ROBOT_SIDE, GROUND_SIDE)]
    return bool(counts[0] == counts[1])

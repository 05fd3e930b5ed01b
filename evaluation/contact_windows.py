# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Exchange of generated products between two stores over a simulated link with contact windows.

``kills`` are seeded runs with killed processes and an outage, ``long`` a fifth as many in longer windows.
``capacity`` are full windows without faults. ``delays`` measures commands, alarms and poses while the link is
full. All steps have a deadline.
"""

from __future__ import annotations

import math
import statistics
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

from cdff_dev.contact.seeded_run import CYCLE, RATE_BIT_S, WINDOW_S, seeded_run
from cdff_dev.contact.simulated_link import Direction
from cdff_dev.contact.two_stores import GROUND_SIDE, ROBOT_SIDE, TwoStores

PARTS = ("kills", "long", "capacity", "delays")
#: Number of runs with kills.
OPTIONS = {"count": 100}
#: Loss and one-way delay in seconds of the full windows without faults.
_LINKS = ((0.0, 0.05), (0.02, 0.05), (0.02, 0.5), (0.05, 0.5))
_LOSSES, _DELAY_S, _UP_BIT_S = (0.0, 0.02), 0.05, 2e5
_MEASUREMENTS, _WINDOW_S, _LIMIT_S = 20, 300.0, 30.0
#: Products that keep the link full during the measurement of delays.
_CYCLES = 15
#: Runs with kills at the same time: most of their time they wait for the link.
_AT_ONCE = 4
#: Duration of the window of ``long``, seconds, and cycles of products that fill it.
_LONG_S, _LONG_CYCLES = 120.0, 27
#: Windows of the parts with kills, and bounds of the intervals of the one-way delay in the table, seconds.
_DELAY_BOUNDS_S = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
_WINDOWS_S = {"kills": WINDOW_S, "long": _LONG_S}
#: 64 bytes of names and values.
_COMMAND = {"type": "dem", "frame": "site", "region": "bbox:-10.5,-10.5,10.5,10.", "max_age_s": "86400.00"}


def evaluate(
    data: Path, progress: Callable[[str], None], parts: Sequence[str] = PARTS, count: int = OPTIONS["count"]
) -> dict[str, Any]:
    """Return the figures of the parts; the data folder is not used."""
    figures: dict[str, Any] = {}
    if "kills" in parts:
        figures["kills"] = _runs(progress, "kills", count)
    if "long" in parts:
        options = {"window_s": _LONG_S, "cycles": _LONG_CYCLES}
        figures["long"] = _runs(progress, "long", math.ceil(count / 5), **options)
    if "capacity" in parts:
        figures["capacity"] = [
            {"loss": loss, **_run(progress, "capacity", 0, kills=0, loss=loss, delay_s=delay_s)}
            for loss, delay_s in _LINKS
        ]
    if "delays" in parts:
        figures["delays"] = [_delays(progress, loss) for loss in _LOSSES]
    return figures


def _runs(progress: Callable[[str], None], part: str, count: int, **options: Any) -> list[dict[str, Any]]:
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        return list(pool.map(lambda seed: _run(progress, part, seed, **options), range(count)))


def _run(progress: Callable[[str], None], part: str, seed: int, **options: Any) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as folder:
        result = seeded_run(Path(folder), seed, **options).to_dict()
    progress(f"contact_windows {part}: {result}")
    return result


def _delays(progress: Callable[[str], None], loss: float) -> dict[str, Any]:
    """Return the delays of commands, alarms and poses in addition to the one-way delay, seconds."""
    down, up = Direction(RATE_BIT_S, _DELAY_S, loss), Direction(_UP_BIT_S, _DELAY_S, loss)
    commands_ns: dict[str, int] = {}
    alarms_s, poses_s = [], []
    with (
        tempfile.TemporaryDirectory() as folder,
        TwoStores(Path(folder), [(0.0, _WINDOW_S)], down, up) as both,
    ):
        both.start(ROBOT_SIDE, GROUND_SIDE)
        clouds = [CYCLE * n + CYCLE - 1 for n in range(_CYCLES)]
        both.call(ROBOT_SIDE, "put", seed=0, numbers=clouds)
        both.begin()
        both.wait_for(
            lambda: both.call(GROUND_SIDE, "status")["bytes_received"] > 200_000, _LIMIT_S, "a full link"
        )
        for n in range(_MEASUREMENTS):
            identity = f"r{n}"
            made = both.call(GROUND_SIDE, "request", request_id=identity, parameters=_COMMAND, expires_s=60.0)
            commands_ns[identity] = made["made_ns"]
            both.call(ROBOT_SIDE, "alarm", label=identity)
            alarms_s.append(_time_of(both, "has_alarm_of_robot", label=identity))
            (pose,) = both.call(ROBOT_SIDE, "put", seed=0, numbers=[CYCLE * _CYCLES + n])
            poses_s.append(_time_of(both, "has", product_id=pose))
        both.wait_for(
            lambda: len(both.call(ROBOT_SIDE, "requests")) == _MEASUREMENTS, _LIMIT_S, "the last command"
        )
        is_full = bool(both.call(ROBOT_SIDE, "status")["backlog"])
        taken = both.call(ROBOT_SIDE, "requests")
    commands_s = [(row["made_ns"] - commands_ns[row["id"]]) / 1e9 for row in taken]
    names = {"commands": commands_s, "alarms": alarms_s, "poses": poses_s}
    figures = {name: _summary(values) for name, values in names.items()}
    progress(f"contact_windows delays: {figures}")
    return {"loss": loss, "is_full": is_full, "number": _MEASUREMENTS, **figures}


def _time_of(both: TwoStores, name: str, **arguments: Any) -> float:
    """Return the time until a command of the ground returns true, seconds."""
    start_s = time.monotonic()
    both.wait_for(lambda: both.call(GROUND_SIDE, name, **arguments), _LIMIT_S, f"{name} {arguments}")
    return time.monotonic() - start_s


def _summary(times_s: Sequence[float]) -> dict[str, float]:
    """Return median and maximum in addition to the one-way delay, milliseconds."""
    return {
        "median_ms": round((statistics.median(times_s) - _DELAY_S) * 1e3),
        "largest_ms": round((max(times_s) - _DELAY_S) * 1e3),
    }


def table(figures: Mapping[str, Any]) -> str:
    """Return the tables of the parts."""
    lines = []
    if any(figures.get(part) for part in _WINDOWS_S):
        lines += [
            "| window | runs | products | lost | wrong | stored twice | used: median, least, runs ≥ 80 % "
            "| of the whole window: median, least | resent: median, largest, runs ≤ 10 % |",
            "|---|---|---|---|---|---|---|---|---|",
        ]
        lines += [_kills(runs, _WINDOWS_S[part]) for part in _WINDOWS_S if (runs := figures.get(part))]
        lines += ["", "| window | one-way delay | runs | used: median, runs ≥ 80 % |", "|---|---|---|---|"]
        for part in _WINDOWS_S:
            lines += _by_delay(figures.get(part) or [], _WINDOWS_S[part])
        lines.append("")
    if runs := figures.get("capacity"):
        lines += ["| loss | one-way delay | used | resent | out of order |", "|---|---|---|---|---|"]
        lines += [
            f"| {_percent(r['loss'])} | {r['delay_s']:g} s | {_percent(r['used'])} "
            f"| {_percent(r['resent'])} | {r['disordered']} of {r['products']} |"
            for r in runs
        ]
        lines.append("")
    if rows := figures.get("delays"):
        names = ("commands", "alarms", "poses")
        lines += [
            "| loss | " + " | ".join(f"{name}: median, largest" for name in names) + " |",
            "|---|---|---|---|",
        ]
        lines += [
            f"| {_percent(r['loss'])} | "
            + " | ".join(f"{r[name]['median_ms']}, {r[name]['largest_ms']} ms" for name in names)
            + " |"
            for r in rows
        ]
    return "\n".join(lines).rstrip()


def _kills(runs: Sequence[Mapping[str, Any]], window_s: float) -> str:
    """Return the row of runs with kills in windows of one duration."""
    used, of_all, resent = ([r[name] for r in runs] for name in ("used", "used_of_all", "resent"))
    cells = [
        f"{window_s:g} s",
        len(runs),
        *(sum(r[name] for r in runs) for name in ("products", "lost", "wrong", "twice")),
        f"{_percent(statistics.median(used))}, {_percent(min(used))}, {sum(u >= 0.8 for u in used)}",
        f"{_percent(statistics.median(of_all))}, {_percent(min(of_all))}",
        f"{_percent(statistics.median(resent))}, {_percent(max(resent))}, {sum(r <= 0.1 for r in resent)}",
    ]
    return "| " + " | ".join(map(str, cells)) + " |"


def _by_delay(runs: Sequence[Mapping[str, Any]], window_s: float) -> list[str]:
    """Return a row for each interval of the one-way delay of the runs."""
    rows = []
    for low_s, high_s in pairwise(_DELAY_BOUNDS_S):
        used = [r["used"] for r in runs if low_s <= r["delay_s"] < high_s]
        if used:
            median, met = _percent(statistics.median(used)), sum(u >= 0.8 for u in used)
            rows.append(f"| {window_s:g} s | {low_s:g} s to {high_s:g} s | {len(used)} | {median}, {met} |")
    return rows


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"

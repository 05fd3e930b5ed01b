# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What each way of lidar localisation to search the whole map finds alone, without guess or prediction.

Searched for are the sweeps of ``lidar_localisation``, which are rings on smooth ground, clouds spread evenly over
fractal ground with rocks, and such clouds of ground that the map does not show. The two ways run in two processes.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Dfpc
from cdff_common.interfaces.product import Status
from cdff_dev.evaluate._terrain import SENSOR_M, Terrain
from cdff_dev.evaluate.lidar_localisation import LIMIT_DEG, LIMIT_M, WRONG_M, localised, localiser, place, trial
from cdff_dev.registration.rates import in_words, interval, pose_errors

#: Its page and what else is there are those of this evaluation.
PAGE = "lidar_localisation"

WAYS = ("shape", "descriptors")
SEARCHES = 500
SPREAD_M, SPREAD_POINTS = 18.0, 12_000


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Searches by each way."""
    progress(f"lidar localisation: {SEARCHES} searches of each kind by {' and by '.join(WAYS)}")
    with ProcessPoolExecutor(len(WAYS), mp_context=get_context("spawn")) as pool:
        return dict(zip(WAYS, pool.map(searched, WAYS), strict=True))


def searched(way: str) -> dict[str, Any]:
    """What one way finds on the whole map."""
    rings, even, elsewhere = [], [], []
    ground, fractal, other = place(), Terrain(0), Terrain(1)
    on_smooth, on_fractal = (localiser(m, relocalise_by=[way]) for m in (ground.map(0), surface(fractal)))
    for seed in range(SEARCHES):
        T, points, _ = trial(ground, seed)
        rings.append(_answer(on_smooth, points, T))
        T, points = even_sweep(fractal, seed)
        even.append(_answer(on_fractal, points, T))
        _, points = even_sweep(other, seed)
        elsewhere.append(_answer(on_fractal, points, None))
    return {
        "rings on smooth ground": _found(rings), "even clouds on fractal ground": _found(even),
        "accepted where the map does not show it": interval(sum(a is not None for a in elsewhere), SEARCHES),
    }  # fmt: skip


def surface(ground: Terrain) -> FloatArray:
    """A map (300 000, 3) of fractal ground, the whole of it."""
    rng = np.random.default_rng(0)
    xy = rng.uniform(1.0, ground.size_m - 1.0, (300_000, 2))
    return np.c_[xy, ground.height(xy) + rng.normal(0.0, 0.01, len(xy))]


def even_sweep(ground: Terrain, seed: int) -> tuple[FloatArray, FloatArray]:
    """``T_map_lidar`` of a robot that stands level, and points (12 000, 3) spread over 18 m about it, 1 cm noise."""
    rng = np.random.default_rng([seed, 5])
    xy, heading = rng.uniform(SPREAD_M + 2.0, ground.size_m - SPREAD_M - 2.0, 2), rng.uniform(-np.pi, np.pi)
    T = se3.transform(se3.exp_so3([0.0, 0.0, heading]), [*xy, ground.height(xy[None])[0] + SENSOR_M])
    r, a = SPREAD_M * np.sqrt(rng.random(SPREAD_POINTS)), rng.uniform(-np.pi, np.pi, SPREAD_POINTS)
    seen = xy + np.column_stack([r * np.cos(a), r * np.sin(a)])
    points = np.c_[seen, ground.height(seen) + rng.normal(0.0, 0.01, SPREAD_POINTS)]
    return T, se3.transform_points(se3.inverse(T), points)


def _answer(dfpc: Dfpc, points_m: FloatArray, T_true: FloatArray | None) -> tuple[float, float] | None:
    """Errors of the answer, 0 where there is no truth; None where it is refused."""
    output = localised(dfpc, points_m, None)
    if output.quality.status is Status.FAILED:
        return None
    return (0.0, 0.0) if T_true is None else pose_errors(output.value.transform.matrix, T_true)


def _found(answers: list[tuple[float, float] | None]) -> dict[str, Any]:
    right = sum(a is not None and a[0] <= LIMIT_M and a[1] <= LIMIT_DEG for a in answers)
    wrong = sum(a is not None and a[0] > WRONG_M for a in answers)
    return {
        "within_3_cm_and_0.1_deg": interval(right, len(answers)), "wrong": interval(wrong, len(answers)),
        "refused": sum(a is None for a in answers),
    }  # fmt: skip


def table(figures: dict[str, Any]) -> str:
    """Searches by each way."""
    lines = ["| searched, no guess | by shape | by descriptors |", "|---|---|---|"]
    for name in figures[WAYS[0]]:
        cells = []
        for way in WAYS:
            row = figures[way][name]
            if "refused" in row:
                right, wrong = in_words(row["within_3_cm_and_0.1_deg"]), in_words(row["wrong"])
                cells.append(f"{right}, {row['refused']} refused, wrong {wrong}")
            else:
                cells.append(in_words(row))
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)

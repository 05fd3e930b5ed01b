# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate each search method of lidar localisation on the whole map, without a guess.

Three kinds of sweeps are searched for: the sweeps of ``lidar_localisation``, which are rings on smooth
ground; uniform clouds of fractal ground with rocks; and uniform clouds of ground that is not on the map. The
two methods run in two processes.
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
from cdff_dev.compare.registration.rates import interval, pose_errors, rate_text
from evaluation.lidar_localisation import (
    LIMIT_DEG,
    LIMIT_M,
    WRONG_M,
    localise,
    make_localiser,
    simulated_ground,
    trial,
)
from evaluation.scenes.terrain import SENSOR_M, Terrain

#: Page that contains the table of this evaluation.
PAGE = "lidar_localisation"

SEARCH_METHODS = ("shape", "descriptors")
SEARCHES = 500
SPREAD_M, SPREAD_POINTS = 18.0, 12_000


def evaluate(_data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results of each search method."""
    progress(f"lidar localisation: {SEARCHES} searches of each kind by {' and by '.join(SEARCH_METHODS)}")
    with ProcessPoolExecutor(len(SEARCH_METHODS), mp_context=get_context("spawn")) as pool:
        return dict(zip(SEARCH_METHODS, pool.map(evaluate_method, SEARCH_METHODS), strict=True))


def evaluate_method(method: str) -> dict[str, Any]:
    """Return the results of one search method on the whole map."""
    rings, uniform, off_map = [], [], []
    ground, fractal, other = simulated_ground(), Terrain(0), Terrain(1)
    smooth_localiser, fractal_localiser = (
        make_localiser(m, relocalise_by=[method]) for m in (ground.map(0), surface(fractal))
    )
    for seed in range(SEARCHES):
        T, points, _ = trial(ground, seed)
        rings.append(_answer(smooth_localiser, points, T))
        T, points = uniform_sweep(fractal, seed)
        uniform.append(_answer(fractal_localiser, points, T))
        _, points = uniform_sweep(other, seed)
        off_map.append(_answer(fractal_localiser, points, None))
    return {
        "rings on smooth ground": _summary(rings),
        "uniform clouds on fractal ground": _summary(uniform),
        "accepted outside the map": interval(sum(answer is not None for answer in off_map), SEARCHES),
    }


def surface(ground: Terrain) -> FloatArray:
    """Return a map (300 000, 3) of the whole fractal ground."""
    rng = np.random.default_rng(0)
    xy = rng.uniform(1.0, ground.size_m - 1.0, (300_000, 2))
    return np.c_[xy, ground.height(xy) + rng.normal(0.0, 0.01, len(xy))]


def uniform_sweep(ground: Terrain, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return ``T_map_lidar`` of a level robot, and points (12 000, 3) within 18 m of it with 1 cm noise."""
    rng = np.random.default_rng([seed, 5])
    xy, heading = rng.uniform(SPREAD_M + 2.0, ground.size_m - SPREAD_M - 2.0, 2), rng.uniform(-np.pi, np.pi)
    T = se3.transform(se3.exp_so3([0.0, 0.0, heading]), [*xy, ground.height(xy[None])[0] + SENSOR_M])
    radii, angles = SPREAD_M * np.sqrt(rng.random(SPREAD_POINTS)), rng.uniform(-np.pi, np.pi, SPREAD_POINTS)
    points_xy = xy + np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])
    points = np.c_[points_xy, ground.height(points_xy) + rng.normal(0.0, 0.01, SPREAD_POINTS)]
    return T, se3.transform_points(se3.inverse(T), points)


def _answer(dfpc: Dfpc, points_m: FloatArray, T_true: FloatArray | None) -> tuple[float, float] | None:
    """Return the errors of the answer (0 without a true pose), or None if it is refused."""
    output = localise(dfpc, points_m, None)
    if output.quality.status is Status.FAILED:
        return None
    return (0.0, 0.0) if T_true is None else pose_errors(output.value.transform.matrix, T_true)


def _summary(answers: list[tuple[float, float] | None]) -> dict[str, Any]:
    accurate = sum(
        answer is not None and answer[0] <= LIMIT_M and answer[1] <= LIMIT_DEG for answer in answers
    )
    wrong = sum(answer is not None and answer[0] > WRONG_M for answer in answers)
    return {
        "within_3_cm_and_0.1_deg": interval(accurate, len(answers)),
        "wrong": interval(wrong, len(answers)),
        "refused": sum(answer is None for answer in answers),
    }


def table(figures: dict[str, Any]) -> str:
    """Return the table with one column for each search method."""
    lines = ["| map and sweeps, no guess | `shape` | `descriptors` |", "|---|---|---|"]
    for name in figures[SEARCH_METHODS[0]]:
        cells = []
        for method in SEARCH_METHODS:
            row = figures[method][name]
            if "refused" in row:
                accurate, wrong = rate_text(row["within_3_cm_and_0.1_deg"]), rate_text(row["wrong"])
                cells.append(f"{accurate}, {row['refused']} refused, wrong {wrong}")
            else:
                cells.append(rate_text(row))
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(lines)

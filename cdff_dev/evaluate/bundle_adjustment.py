# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bundle adjustment beside GTSAM and COLMAP (Ceres) on one objective; whether covariances are as large as errors.

Real: the BAL and libmv problems. Simulated: a ring of cameras. Costs are half the sum of squared residuals, computed by
our own code from each solver's poses, points and lenses. COLMAP where CDFF_PEER_PYTHON names an environment that has
pycolmap.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_common.formats.bal import read_bal
from cdff_common.formats.libmv import read_libmv
from cdff_common.geometry import covariance as cov
from cdff_common.interfaces.registry import Registry
from cdff_common.types import BundleProblem
from cdff_common.types.bundle_ext import FOCAL, K1, K2
from cdff_core.dfns.bundle_optimization._interface import BundleOptimizationInputs, BundleOptimizationOutputs
from cdff_dev.evaluate._bundles import by_ceres, by_gtsam, cost, ring
from cdff_dev.evaluate._chart import Bar, Panel, chart
from cdff_dev.evaluate._peers import peer_python

TOLERANCE = 1e-9
TRIALS = 50


def evaluate(data: Path, progress: Callable[[str], None], trials: int = TRIALS) -> dict[str, Any]:
    """Costs and times of every solver, and consistency of covariances."""
    problems = {
        "dubrovnik-3-7 (BAL, real)": read_bal(data / "bundle" / "dubrovnik-3-7-pre.txt", frame="site"),
        "problem_01 (libmv, real)": read_libmv(data / "bundle" / "problem_01.bin", frame="site"),
        "ring of 40, fixed lenses (simulated)": ring()[0],
        "ring of 40, free lens (simulated)": ring(free=FOCAL | K1 | K2)[0],
    }
    figures: dict[str, Any] = {"costs": {}}
    for name, problem in problems.items():
        progress(f"bundle_adjustment: {name}")
        figures["costs"][name] = compared(problem)
    progress("bundle_adjustment: covariances")
    return figures | {"covariances": consistency(trials)}


def solved(problem: BundleProblem, **config: Any) -> tuple[BundleOptimizationOutputs, dict[str, float], float]:
    """Our answer, its metrics, and CPU seconds."""
    dfn = Registry.default().make_dfn("bundle_optimization")
    dfn.configure(config)
    started = time.process_time()
    found = dfn.process(BundleOptimizationInputs(problem))
    return found, dict(dfn.metrics), time.process_time() - started


def compared(problem: BundleProblem) -> dict[str, Any]:
    """Cost and CPU seconds of each solver."""
    found, metrics, cpu_s = solved(problem, covariances="none", tolerance=TOLERANCE)
    row: dict[str, Any] = {
        "cameras": len(problem.cameras.ids), "points": len(problem.points.ids),
        "observations": len(problem.observations.cameras), "cost_initial": cost(problem),
        "cdff": {"cost": cost(found.problem), "cpu_s": cpu_s, "iterations": metrics["iterations"]},
    }  # fmt: skip
    answer, cpu_s = by_gtsam(problem, TOLERANCE)
    row["gtsam"] = {"cost": cost(answer), "cpu_s": cpu_s}
    peer = peer_python()
    if peer:
        answer, cpu_s = by_ceres(peer, problem, TOLERANCE)
        row["ceres"] = {"cost": cost(answer), "cpu_s": cpu_s}
    return row


def consistency(trials: int) -> dict[str, Any]:
    """Mean squared error over stated covariance, of poses and points, over seeds; 1 where they are right.

    The gauge is that of the truth: two cameras are held where they are.
    """
    poses, points = [], []
    for seed in range(trials):
        problem, T_true, X_true = ring(8, 60, 6, 1.0, seed)
        cameras = problem.cameras
        T = cameras.matrices
        T[:2] = T_true[:2]
        o = problem.observations
        held = BundleProblem.from_arrays(
            T, problem.lenses.values, problem.points.positions, (o.cameras, o.points), o.pixels, frame="site",
            fixed=[1, 1] + [0] * (len(T) - 2),
        )  # fmt: skip
        found, *_ = solved(held)
        for T, T_found, covariance in zip(
            T_true[2:], found.problem.cameras.matrices[2:], found.pose_covariances[2:], strict=True
        ):
            error = cov.pose_error(T, T_found)
            poses.append(float(error @ np.linalg.solve(covariance, error)) / 6.0)
        e = found.problem.points.positions - X_true
        points += (np.einsum("ni,nij,nj->n", e, np.linalg.inv(found.point_covariances), e) / 3.0).tolist()
    return {"trials": trials, "poses": _ratio(poses, trials), "points": _ratio(points, trials)}


def _ratio(values: list[float], seeds: int) -> dict[str, float]:
    """Mean and its 95 % interval over seeds: values of one seed depend on one another."""
    blocks = np.array(values).reshape(seeds, -1).mean(axis=1)
    half = 1.96 * float(blocks.std()) / len(blocks) ** 0.5
    mean = float(np.mean(values))
    return {"mean": round(mean, 3), "low": round(mean - half, 3), "high": round(mean + half, 3)}


def draw(figures: dict[str, Any]) -> bytes:
    """Costs over the least of all solvers, CPU time, and consistency."""
    rows = {name: row for name, row in figures["costs"].items() if row["cdff"]["cost"] > 1e-6}
    solvers = [s for s in ("cdff", "gtsam", "ceres") if all(s in row for row in rows.values())]
    names = [name.split(" (")[0] for name in rows]
    least = [min(row[s]["cost"] for s in solvers) for row in rows.values()]
    ratios: dict[str, list[Bar | None]] = {
        s: [(row[s]["cost"] / low,) * 3 for row, low in zip(rows.values(), least, strict=True)] for s in solvers
    }
    times: dict[str, list[Bar | None]] = {s: [(row[s]["cpu_s"],) * 3 for row in rows.values()] for s in solvers}
    ratio = figures["covariances"]
    nees: list[Bar | None] = [tuple(ratio[k][e] for e in ("mean", "low", "high")) for k in ("poses", "points")]  # type: ignore[misc]  # three ends
    top = max(row[s]["cpu_s"] for row in rows.values() for s in solvers)
    return chart(
        [
            Panel("cost over the least of all", names, ratios, 1.01),
            Panel("CPU s", names, times, 1.1 * top),
            Panel("squared error over covariance", ["poses", "points"], {"cdff": nees}, 2.0),
        ]
    )


def table(figures: dict[str, Any]) -> str:
    """Costs and times of every solver; consistency."""
    lines = ["| problem | size | cost before | solver | cost after | CPU s |", "|---" * 6 + "|"]
    for name, row in figures["costs"].items():
        size = f"{row['cameras']} cameras, {row['points']} points, {row['observations']} observations"
        lines += [
            f"| {name} | {size} | {row['cost_initial']:.6g} | {solver} | {row[solver]['cost']:.8g} | "
            f"{row[solver]['cpu_s']:.2f} |"
            for solver in ("cdff", "gtsam", "ceres")
            if solver in row
        ]
    lines.append("")
    for what in ("poses", "points"):
        r = figures["covariances"][what]
        lines.append(
            f"Squared error of {what} over stated covariance: {r['mean']} ({r['low']} to {r['high']}) of what is "
            f"expected, {figures['covariances']['trials']} simulated rings of 8 cameras."
        )
    return "\n".join(lines)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare bundle adjustment with GTSAM and COLMAP (Ceres) on one objective; evaluate its covariances.

The BAL and libmv problems are real, the ring of cameras is simulated. The cost is half the sum of squared
residuals; the same function computes it from the poses, points and lenses of each solver. COLMAP runs if
CDFF_PEER_PYTHON names an environment with pycolmap.
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
from cdff_core.dfns.bundle_optimization.interface import BundleOptimizationInputs, BundleOptimizationOutputs
from evaluation.chart import Bar, Panel, chart
from evaluation.peers.environments import peer_python
from evaluation.scenes.bundles import cost, ring, solve_with_ceres, solve_with_gtsam

TOLERANCE = 1e-9
TRIALS = 50


def evaluate(data: Path, progress: Callable[[str], None], trials: int = TRIALS) -> dict[str, Any]:
    """Return costs and times of each solver, and the consistency of the covariances."""
    problems = {
        "dubrovnik-3-7 (BAL, real)": read_bal(data / "bundle" / "dubrovnik-3-7-pre.txt", frame="site"),
        "problem_01 (libmv, real)": read_libmv(data / "bundle" / "problem_01.bin", frame="site"),
        "ring of 40, fixed lenses (simulated)": ring()[0],
        "ring of 40, free lens (simulated)": ring(free=FOCAL | K1 | K2)[0],
    }
    figures: dict[str, Any] = {"costs": {}}
    for name, problem in problems.items():
        progress(f"bundle_adjustment: {name}")
        figures["costs"][name] = compare_solvers(problem)
    progress("bundle_adjustment: covariances")
    return figures | {"covariances": consistency(trials)}


def solve(problem: BundleProblem, **config: Any) -> tuple[BundleOptimizationOutputs, dict[str, float], float]:
    """Return the outputs of the DFN, its metrics, and CPU seconds."""
    dfn = Registry.default().make_dfn("bundle_optimization")
    dfn.configure(config)
    started = time.process_time()
    outputs = dfn.process(BundleOptimizationInputs(problem=problem))
    return outputs, dict(dfn.metrics), time.process_time() - started


def compare_solvers(problem: BundleProblem) -> dict[str, Any]:
    """Return the cost and CPU seconds of each solver."""
    solution, metrics, cpu_s = solve(problem, covariances="none", tolerance=TOLERANCE)
    row: dict[str, Any] = {
        "cameras": len(problem.cameras.ids),
        "points": len(problem.points.ids),
        "observations": len(problem.observations.cameras),
        "cost_initial": cost(problem),
        "cdff": {"cost": cost(solution.problem), "cpu_s": cpu_s, "iterations": metrics["iterations"]},
    }
    adjusted, cpu_s = solve_with_gtsam(problem, TOLERANCE)
    row["gtsam"] = {"cost": cost(adjusted), "cpu_s": cpu_s}
    peer = peer_python()
    if peer:
        adjusted, cpu_s, _ = solve_with_ceres(peer, problem, TOLERANCE)
        row["ceres"] = {"cost": cost(adjusted), "cpu_s": cpu_s}
    return row


def consistency(trials: int) -> dict[str, Any]:
    """Return the NEES of poses and points, divided by its expected value, so that 1 is expected.

    Two cameras are fixed at their true poses, so that errors and covariances have the same gauge.
    """
    poses, points = [], []
    for seed in range(trials):
        problem, T_true, X_true = ring(8, 60, 6, 1.0, seed)
        cameras = problem.cameras
        T_initial = cameras.matrices
        T_initial[:2] = T_true[:2]
        observations = problem.observations
        fixed_problem = BundleProblem.from_arrays(
            T_initial,
            problem.lenses.values,
            problem.points.positions,
            (observations.cameras, observations.points),
            observations.pixels,
            frame="site",
            fixed=[1, 1] + [0] * (len(T_initial) - 2),
        )
        solution, *_ = solve(fixed_problem)
        for T, T_estimated, covariance in zip(
            T_true[2:], solution.problem.cameras.matrices[2:], solution.pose_covariances[2:], strict=True
        ):
            error = cov.pose_error(T, T_estimated)
            poses.append(float(error @ np.linalg.solve(covariance, error)) / 6.0)
        e = solution.problem.points.positions - X_true
        points += (np.einsum("ni,nij,nj->n", e, np.linalg.inv(solution.point_covariances), e) / 3.0).tolist()
    return {"trials": trials, "poses": _ratio(poses, trials), "points": _ratio(points, trials)}


def _ratio(values: list[float], seeds: int) -> dict[str, float]:
    """Return the mean and its 95 % interval over seeds, because values of one seed are correlated."""
    blocks = np.array(values).reshape(seeds, -1).mean(axis=1)
    half = 1.96 * float(blocks.std()) / len(blocks) ** 0.5
    mean = float(np.mean(values))
    return {"mean": round(mean, 3), "low": round(mean - half, 3), "high": round(mean + half, 3)}


def draw(figures: dict[str, Any]) -> bytes:
    """Return the diagram: cost relative to the best solver, CPU time, consistency of covariances, as SVG."""
    rows = {name: row for name, row in figures["costs"].items() if row["cdff"]["cost"] > 1e-6}
    solvers = [s for s in ("cdff", "gtsam", "ceres") if all(s in row for row in rows.values())]
    names = [name.split(" (")[0] for name in rows]
    lowest = [min(row[s]["cost"] for s in solvers) for row in rows.values()]
    ratios: dict[str, list[Bar | None]] = {
        s: [(row[s]["cost"] / low,) * 3 for row, low in zip(rows.values(), lowest, strict=True)]
        for s in solvers
    }
    times: dict[str, list[Bar | None]] = {
        s: [(row[s]["cpu_s"],) * 3 for row in rows.values()] for s in solvers
    }
    ratio = figures["covariances"]
    nees: list[Bar | None] = [
        tuple(ratio[k][e] for e in ("mean", "low", "high")) for k in ("poses", "points")
    ]  # type: ignore[misc]  # each tuple has three values
    top = max(row[s]["cpu_s"] for row in rows.values() for s in solvers)
    return chart(
        [
            Panel("cost / lowest cost", names, ratios, 1.01),
            Panel("CPU s", names, times, 1.1 * top),
            Panel("NEES / expected value", ["poses", "points"], {"cdff": nees}, 2.0),
        ]
    )


def table(figures: dict[str, Any]) -> str:
    """Return the table: cost and CPU time of each solver, consistency of covariances."""
    lines = ["| problem | size | initial cost | solver | final cost | CPU s |", "|---" * 6 + "|"]
    for name, row in figures["costs"].items():
        size = f"{row['cameras']} cameras, {row['points']} points, {row['observations']} observations"
        lines += [
            f"| {name} | {size} | {row['cost_initial']:.6g} | {solver} | {row[solver]['cost']:.8g} | "
            f"{row[solver]['cpu_s']:.2f} |"
            for solver in ("cdff", "gtsam", "ceres")
            if solver in row
        ]
    lines.append("")
    for quantity in ("poses", "points"):
        ratios = figures["covariances"][quantity]
        lines.append(
            f"NEES of the {quantity} divided by its expected value: {ratios['mean']} (95 %: {ratios['low']} "
            f"to {ratios['high']}), from {figures['covariances']['trials']} simulated rings of 8 cameras."
        )
    return "\n".join(lines)

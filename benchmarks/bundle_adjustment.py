# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare bundle adjustment with GTSAM and Ceres: CPU time, covariances and gauge.

OMP_NUM_THREADS=1 python benchmarks/bundle_adjustment.py [--rounds N] [--peer-python PYTHON] [--out FILE]

The problem is the simulated ring of 40 cameras and 56 000 observations of the evaluation. Times of the other
programs exclude graph building, those of CDFF are of the whole DFN. Rounds alternate; the minimum CPU time is
reported. ``covariances``: time for the covariances of all poses, in addition to the adjustment, with two
fixed cameras, and the largest relative difference to GTSAM. ``no_gauge``: the answer of each program if
nothing is fixed. Ceres is that of COLMAP (``--peer-python``: an environment with pycolmap and pyceres).
``ceres, factors in Python``: pyceres with residuals in Python, because its wheel contains no reprojection
factor.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import gtsam
import numpy as np
from _report import write_report

from cdff_common.interfaces.registry import Registry
from cdff_common.types import BundleProblem
from cdff_core.dfns.bundle_optimization.interface import BundleOptimizationInputs, BundleOptimizationOutputs
from evaluation.peers import colmap
from evaluation.scenes.bundles import (
    cost,
    gtsam_covariances,
    gtsam_graph,
    gtsam_values,
    ring,
    solve_with_ceres,
    solve_with_gtsam,
)

TOLERANCE = 1e-9
_PYCERES = """
import sys, time, numpy as np, pyceres
z = np.load(sys.argv[1])
R, c, X, uv, f = z["R"], z["c"], z["X"], z["uv"], float(z["focal"])
class Reprojection(pyceres.CostFunction):
    def __init__(self, R, uv):
        super().__init__()
        self.R, self.uv = R, uv
        self.set_num_residuals(2)
        self.set_parameter_block_sizes([3, 3])
    def Evaluate(self, parameters, residuals, jacobians):
        p = self.R @ (parameters[1] - parameters[0])
        residuals[:] = f * p[:2] / p[2] - self.uv
        if jacobians is not None:
            J = f / p[2] * np.array([[1, 0, -p[0] / p[2]], [0, 1, -p[1] / p[2]]]) @ self.R
            if jacobians[0] is not None:
                jacobians[0][:] = -J.ravel()
            if jacobians[1] is not None:
                jacobians[1][:] = J.ravel()
        return True
problem = pyceres.Problem()
factors = [Reprojection(R[i], uv[k]) for k, i in enumerate(z["cam"])]
for factor, i, j in zip(factors, z["cam"], z["pt"]):
    problem.add_residual_block(factor, None, [c[i], X[j]])
options = pyceres.SolverOptions()
options.num_threads, options.max_num_iterations = 1, 3
options.linear_solver_type = pyceres.LinearSolverType.SPARSE_SCHUR
summary = pyceres.SolverSummary()
started = time.process_time()
pyceres.solve(options, problem, summary)
steps = summary.num_successful_steps + summary.num_unsuccessful_steps
np.savez(sys.argv[2], cpu=(time.process_time() - started) / max(steps, 1))
"""


def solve_with_cdff(
    problem: BundleProblem, covariances: str
) -> tuple[BundleOptimizationOutputs, tuple[str, ...], dict[str, float], float]:
    """Return outputs, reasons and metrics of the DFN, and CPU seconds."""
    node = Registry.default().make_dfn("bundle_optimization")
    node.configure({"covariances": covariances, "tolerance": TOLERANCE})
    start_s = time.process_time()
    outputs = node.process(BundleOptimizationInputs(problem=problem))
    return outputs, node.reasons, dict(node.metrics), time.process_time() - start_s


def adjustment(rounds: int, python: str | None) -> dict[str, Any]:
    """Return final costs, and CPU seconds of the adjustment and of the covariances of all poses."""
    problem = ring()[0]
    cameras = replace(problem.cameras, fixed=np.array([1, 1] + [0] * 38, np.uint8))
    with_two_fixed = replace(problem, cameras=cameras)
    times: dict[str, list[float]] = {}
    costs: dict[str, float] = {}
    for _ in range(rounds):
        outputs, _, _, cpu_s = solve_with_cdff(problem, "none")
        costs["cdff"] = cost(outputs.problem)
        times.setdefault("cdff", []).append(cpu_s)
        adjusted, cpu_s = solve_with_gtsam(problem, TOLERANCE)
        costs["gtsam"] = cost(adjusted)
        times.setdefault("gtsam", []).append(cpu_s)
        without_s = solve_with_cdff(with_two_fixed, "none")[3]
        outputs, _, metrics, with_s = solve_with_cdff(with_two_fixed, "poses")
        times.setdefault("cdff, covariances", []).append(with_s - without_s)
        C, cpu_s = gtsam_covariances(outputs.problem)
        times.setdefault("gtsam, covariances", []).append(cpu_s)
        if python:
            adjusted, cpu_s, covariance_s = solve_with_ceres(python, problem, TOLERANCE, covariance=True)
            costs["ceres"] = cost(adjusted)
            times.setdefault("ceres", []).append(cpu_s)
            times.setdefault("ceres, covariances", []).append(covariance_s)
    covariances = outputs.pose_covariances[2:] / metrics["unit_variance"]
    difference = np.abs(covariances - C[2:]).max(axis=(1, 2)) / np.abs(C[2:]).max(axis=(1, 2))
    return {
        "cost": {name: round(value, 6) for name, value in costs.items()},
        "cpu_s": {name: round(min(values), 3) for name, values in times.items()},
        "covariance_relative_difference": float(f"{difference.max():.2g}"),
    }


def python_factors_s(python: str) -> float:
    """Return CPU seconds of an iteration of Ceres with residuals in Python; positions and points are free."""
    problem = ring()[0]
    T, lens, observations = problem.cameras.matrices, problem.lenses.values[0], problem.observations
    inputs = {
        "R": T[:, :3, :3].transpose(0, 2, 1).copy(),
        "c": T[:, :3, 3].copy(),
        "X": problem.points.positions.copy(),
        "uv": observations.pixels[:, :2] - lens[2:4],
        "cam": observations.cameras.astype(np.int64),
        "pt": observations.points.astype(np.int64),
        "focal": np.array(lens[0]),
    }
    return round(float(colmap.run(python, _PYCERES, inputs)["cpu"]), 3)


def no_gauge() -> dict[str, Any]:
    """Return the answers for a small ring without fixed cameras, and for two rings without common points."""
    connected = ring(8, 60, 6)[0]
    observations = connected.observations
    is_within_part = (observations.cameras < 4) == (observations.points < 30)
    columns = {name: getattr(observations, name)[is_within_part] for name in ("cameras", "points", "pixels")}
    two_parts = BundleProblem.from_arrays(
        connected.cameras.matrices,
        connected.lenses.values,
        connected.points.positions,
        (columns["cameras"], columns["points"]),
        columns["pixels"],
        frame="site",
    )
    report: dict[str, Any] = {}
    for name, problem in (("one part", connected), ("two parts", two_parts)):
        outputs, reasons, metrics, _ = solve_with_cdff(problem, "all")
        report[name] = {
            "cdff": {
                "gauge": outputs.gauge.tolist(),
                "directions": metrics["gauge_directions"],
                "reasons": list(reasons),
            },
            "gtsam": _marginals(problem, is_fixed=False),
            "gtsam, first camera fixed": _marginals(problem, is_fixed=True),
        }
    return report


def _marginals(problem: BundleProblem, *, is_fixed: bool) -> str:
    try:
        gtsam.Marginals(gtsam_graph(problem, is_fixed=is_fixed), gtsam_values(problem))
    except RuntimeError as error:
        return str(error).strip().splitlines()[0]
    return "covariances"


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--peer-python", help="interpreter of an environment with pycolmap and pyceres")
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    report: dict[str, Any] = {
        "benchmark": "bundle_adjustment",
        "python": platform.python_version(),
        "threads": os.environ.get("OMP_NUM_THREADS", "all"),
        "load_1min": os.getloadavg()[0],
        "ring of 40": adjustment(args.rounds, args.peer_python),
        "no_gauge": no_gauge(),
    }
    if args.peer_python:
        report["ring of 40"]["ceres, factors in Python, s per iteration"] = python_factors_s(args.peer_python)
    write_report(report, args.out)


if __name__ == "__main__":
    main()

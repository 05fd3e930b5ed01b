# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Chordal initialisation, Gauss-Newton, and graduated non-convexity for loop closures that may be wrong."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field
from scipy.stats import chi2 as chi_squared

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import from_right_perturbation
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import PoseGraph
from cdff_core.dfns.pose_graph_optimization._chordal import chordal, factorised
from cdff_core.dfns.pose_graph_optimization._interface import (
    PoseGraphOptimizationInputs,
    PoseGraphOptimizationInterface,
    PoseGraphOptimizationOutputs,
)
from cdff_core.dfns.pose_graph_optimization._least_squares import Solution, minimised, normal_equations
from cdff_core.dfns.pose_graph_optimization._problem import Float, Int, Problem, problem_of

_GNC_STEP = 1.4
_GNC_ROUNDS = 100
_GNC_INNER = 3


class ChordalGaussNewtonConfig(DfnConfig):
    """Where to begin, what may be wrong, when to end."""

    initialise: Literal["auto", "given", "chordal"] = Field("auto", description="Poses to begin from")
    robust: Literal["none", "gnc"] = Field("none", description="Whether loop closures may be wrong")
    inlier_probability: float = Field(0.999, gt=0.5, lt=1.0, description="Share of right loop closures that are kept")
    max_iterations: int = Field(100, ge=1, le=10_000, description="Normal equations solved at most")
    tolerance: float = Field(1e-10, gt=0.0, lt=1e-2, description="Relative change of chi2 that counts as none")


class ChordalGaussNewton(PoseGraphOptimizationInterface):
    """Begin where the measurements themselves say, then solve by sparse Gauss-Newton with damping when it is needed.

    Notes
    -----
    The objective is ``sum e' Omega e`` with ``e = Log(T_ab^-1 X_a^-1 X_b)``. From odometry alone Gauss-Newton ends in
    local minima where loops are long; the chordal relaxation does not (Carlone et al. 2015,
    doi:10.1109/ICRA.2015.7139836). Loop closures that may be wrong are weighed by graduated non-convexity of truncated
    least squares (Yang et al. 2020, doi:10.1109/LRA.2020.2965893); odometry and priors keep their weight.

    A graph that grew by a few vertices is solved again from its poses (``initialise: given``): where nothing new
    contradicts them no equation is solved at all.
    """

    Config: ClassVar[type[DfnConfig]] = ChordalGaussNewtonConfig

    def process(self, inputs: PoseGraphOptimizationInputs) -> PoseGraphOptimizationOutputs:
        """Return the optimised graph; raises InputError and DegenerateGeometryError."""
        cfg: Any = self.config
        problem = problem_of(inputs.graph)
        given = inputs.graph.vertices.matrices
        wanted = _rows_of(inputs)
        weights = np.ones(len(problem.first))
        if cfg.robust == "gnc" and problem.is_loop.any():
            found, weights = self._robust(problem, given)
        else:
            found = self._minimised(problem, self._start(problem, given, np.inf), weights)
        self.reasons = _reasons(problem, found, weights)
        self.metrics = {
            f"chi2_{when}": float(weights @ problem.squared(problem.errors(poses)))
            for when, poses in (("initial", given), ("final", found.poses))
        }
        return PoseGraphOptimizationOutputs(
            graph=_with_poses(inputs.graph, found.poses, problem.held),
            iterations=np.array(found.iterations),
            converged=np.array(found.converged),
            gauge=inputs.graph.vertices.ids[problem.held],
            weights=weights,
            covariances=_covariances(problem, found.poses, weights, wanted),
        )

    def _minimised(self, problem: Problem, poses: Float, weights: Float, most: int | None = None) -> Solution:
        return minimised(problem, poses, weights, most or self.config.max_iterations, self.config.tolerance)

    def _start(self, problem: Problem, given: Float, limit: float) -> Float:
        """Poses to begin from: of those that the configuration allows, the ones of the least truncated cost."""
        ones = np.ones(len(problem.first))
        candidates = [] if self.config.initialise == "chordal" else [given]
        if self.config.initialise != "given":
            candidates.append(chordal(problem, given, ones))
            if np.isfinite(limit):
                candidates.append(chordal(problem, given, np.where(problem.is_loop, 0.0, 1.0)))
        costs = [np.minimum(problem.squared(problem.errors(poses)), limit).sum() for poses in candidates]
        return candidates[int(np.argmin(costs))]

    def _robust(self, problem: Problem, given: Float) -> tuple[Solution, Float]:
        """Solve with weights of loop closures that go from all the same to 0 or 1."""
        limit = float(chi_squared.ppf(self.config.inlier_probability, len(problem.rows)))
        weights = np.ones(len(problem.first))
        found = self._minimised(problem, self._start(problem, given, limit), weights, 2 * _GNC_INNER)
        iterations = found.iterations
        r2 = problem.squared(problem.errors(found.poses))[problem.is_loop]
        mu = limit / max(2.0 * float(r2.max()) - limit, 1e-9 * limit)
        for _ in range(_GNC_ROUNDS):
            if r2.max() <= limit or mu > 1e6:
                break
            low, high = mu / (mu + 1.0) * limit, (mu + 1.0) / mu * limit
            between = np.sqrt(limit * mu * (mu + 1.0) / np.maximum(r2, low)) - mu
            loops = np.where(r2 <= low, 1.0, np.where(r2 >= high, 0.0, between))
            weights[problem.is_loop] = loops
            found = self._minimised(problem, found.poses, weights, _GNC_INNER)
            iterations += found.iterations
            r2 = problem.squared(problem.errors(found.poses))[problem.is_loop]
            if np.all((loops < 1e-4) | (loops > 1.0 - 1e-4)):
                break
            mu *= _GNC_STEP
        weights[problem.is_loop] = (r2 <= limit).astype(np.float64)
        last = self._minimised(problem, found.poses, weights)
        return Solution(last.poses, last.chi2, iterations + last.iterations, last.converged), weights


def _rows_of(inputs: PoseGraphOptimizationInputs) -> Int:
    """Rows of the vertices whose covariance is wanted; raises InputError for one that is not there."""
    ids = inputs.graph.vertices.ids
    wanted = np.zeros(0, np.int64) if inputs.wanted is None else np.asarray(inputs.wanted, np.int64).reshape(-1)
    missing = np.setdiff1d(wanted, ids)
    if missing.size:
        raise InputError(f"wanted: vertex {missing[0]} is not in the graph of {len(ids)}")
    order = np.argsort(ids)
    return order[np.searchsorted(ids[order], wanted)]


def _reasons(problem: Problem, found: Solution, weights: Float) -> tuple[str, ...]:
    rejected = int(np.count_nonzero(weights == 0.0))
    counted = (
        ("information_repaired", problem.repaired, problem.repaired > 0),
        ("components", problem.components, problem.components > 1),
        ("loops_rejected", rejected, rejected > 0),
    )
    reasons = [f"{name}:{count}" for name, count, told in counted if told]
    return (*reasons, *(() if found.converged else ("not_converged",)))


def _with_poses(graph: PoseGraph, poses: Float, held: Int) -> PoseGraph:
    fixed = np.zeros(len(poses), np.bool_)
    fixed[held] = True
    vertices, edges = graph.vertices, graph.edges
    return PoseGraph.from_arrays(
        vertices.ids, vertices.stamps_ns, se3.transform(se3.normalise_rotation(poses[:, :3, :3]), poses[:, :3, 3]),
        edges.ends, edges.matrices, edges.information_matrices, edges.kinds,
        frame=graph.frame, fixed=fixed, producer=graph.metadata.producer_id,
    )  # fmt: skip


def _covariances(problem: Problem, poses: Float, weights: Float, wanted: Int) -> Float:
    """Marginal covariances ``(k, 6, 6)``: blocks of the inverse of the normal equations; 0 for what is held."""
    out = np.zeros((len(wanted), 6, 6))
    free = np.setdiff1d(np.arange(len(poses)), problem.held)
    if not len(wanted) or not len(free):
        return out
    d = len(problem.rows)
    factors = factorised(normal_equations(problem, poses, weights)[0])
    for k, row in enumerate(wanted):
        at = np.searchsorted(free, row)
        if at == len(free) or free[at] != row:
            continue
        unit = np.zeros((len(free) * d, d))
        unit[at * d : (at + 1) * d] = np.eye(d)
        block = factors.solve(unit)[at * d : (at + 1) * d]
        whole = np.zeros((6, 6))
        whole[np.ix_(problem.rows, problem.rows)] = 0.5 * (block + block.T)
        out[k] = from_right_perturbation(poses[row], whole)
    return out

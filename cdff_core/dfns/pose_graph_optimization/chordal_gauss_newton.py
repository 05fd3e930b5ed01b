# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Chordal initialisation, Gauss-Newton, and graduated non-convexity for wrong loop closures."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import rotate_covariance
from cdff_common.geometry.robust import GNC_GROWTH, chi_squared_quantile, truncated_weights
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import PoseGraph
from cdff_core.dfns.pose_graph_optimization._chordal import chordal, factorised
from cdff_core.dfns.pose_graph_optimization._least_squares import Solution, minimised, normal_equations
from cdff_core.dfns.pose_graph_optimization._problem import Problem, problem_of
from cdff_core.dfns.pose_graph_optimization.interface import Inputs, Interface, Outputs

_GNC_ROUNDS = 100
_GNC_INNER = 3


class ChordalGaussNewtonConfig(DfnConfig):
    """Parameters of ChordalGaussNewton."""

    initialise: Literal["auto", "given", "chordal"] = Field(
        "auto",
        description=(
            "Initial poses: those of the graph (given), from the measurements alone (chordal), or the "
            "better fit of both (auto)"
        ),
    )
    robust: Literal["none", "gnc"] = Field("none", description="gnc rejects wrong loop closures")
    inlier_probability: float = Field(
        0.999, gt=0.5, lt=1, description="Probability that a correct loop closure is kept"
    )
    max_iterations: int = Field(100, ge=1, le=10_000, description="Maximum number of normal equations solved")
    tolerance: float = Field(1e-10, gt=0, lt=1e-2, description="Relative change of chi2 at convergence")


class ChordalGaussNewton(Interface[ChordalGaussNewtonConfig]):
    """Sparse Gauss-Newton, damped where needed, from initial poses of the measurements themselves.

    Notes
    -----
    The objective is ``sum e' Omega e`` with ``e = Log(T_ab^-1 X_a^-1 X_b)``. Started from odometry,
    Gauss-Newton
    ends in local minima for long loops; with the chordal relaxation it does not (Carlone et al. 2015,
    doi:10.1109/ICRA.2015.7139836). Possibly wrong loop closures are weighted by graduated non-convexity of
    truncated least squares (Yang et al. 2020, doi:10.1109/LRA.2020.2965893); odometry and priors keep their
    weight.

    A graph extended by a few vertices can start from its previous poses (``initialise: given``); where no new
    edge contradicts them no equation is solved.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the optimised graph; raises InputError and DegenerateGeometryError."""
        cfg = self.config
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
        return Outputs(
            graph=_with_poses(inputs.graph, found.poses, problem.held),
            iterations=found.iterations,
            converged=found.converged,
            gauge=inputs.graph.vertices.ids[problem.held],
            weights=weights,
            covariances=_covariances(problem, found.poses, weights, wanted),
        )

    def _minimised(
        self, problem: Problem, poses: FloatArray, weights: FloatArray, most: int | None = None
    ) -> Solution:
        return minimised(problem, poses, weights, most or self.config.max_iterations, self.config.tolerance)

    def _start(self, problem: Problem, given: FloatArray, limit: float) -> FloatArray:
        """Return the initial poses of smallest truncated cost among the configured ones."""
        ones = np.ones(len(problem.first))
        candidates = [] if self.config.initialise == "chordal" else [given]
        if self.config.initialise != "given":
            candidates.append(chordal(problem, given, ones))
            if np.isfinite(limit):
                candidates.append(chordal(problem, given, np.where(problem.is_loop, 0.0, 1.0)))
        costs = [np.minimum(problem.squared(problem.errors(poses)), limit).sum() for poses in candidates]
        return candidates[int(np.argmin(costs))]

    def _robust(self, problem: Problem, given: FloatArray) -> tuple[Solution, FloatArray]:
        """Solve with weights of loop closures that change from equal ones to 0 or 1."""
        limit = chi_squared_quantile(self.config.inlier_probability, len(problem.rows))
        weights = np.ones(len(problem.first))
        found = self._minimised(problem, self._start(problem, given, limit), weights, 2 * _GNC_INNER)
        iterations = found.iterations
        r2 = problem.squared(problem.errors(found.poses))[problem.is_loop]
        mu = limit / max(2.0 * float(r2.max()) - limit, 1e-9 * limit)
        for _ in range(_GNC_ROUNDS):
            if r2.max() <= limit or mu > 1e6:
                break
            weights[problem.is_loop] = loops = truncated_weights(r2, limit, mu)
            found = self._minimised(problem, found.poses, weights, _GNC_INNER)
            iterations += found.iterations
            r2 = problem.squared(problem.errors(found.poses))[problem.is_loop]
            if np.all((loops < 1e-4) | (loops > 1.0 - 1e-4)):
                break
            mu *= GNC_GROWTH
        weights[problem.is_loop] = (r2 <= limit).astype(np.float64)
        last = self._minimised(problem, found.poses, weights)
        return Solution(last.poses, last.chi2, iterations + last.iterations, last.converged), weights


def _rows_of(inputs: Inputs) -> IntArray:
    """Return the rows of the vertices whose covariance is requested; raises InputError for a missing one."""
    ids = inputs.graph.vertices.ids
    wanted = np.asarray(() if inputs.wanted is None else inputs.wanted, np.int64).reshape(-1)
    missing = np.setdiff1d(wanted, ids)
    if missing.size:
        raise InputError(f"wanted: vertex {missing[0]} is not in the graph of {len(ids)}")
    order = np.argsort(ids)
    return order[np.searchsorted(ids[order], wanted)]


def _reasons(problem: Problem, found: Solution, weights: FloatArray) -> tuple[str, ...]:
    rejected = int(np.count_nonzero(weights == 0.0))
    reasons = {
        f"information_repaired:{problem.repaired}": problem.repaired > 0,
        f"components:{problem.components}": problem.components > 1,
        f"loops_rejected:{rejected}": rejected > 0,
        "not_converged": not found.converged,
    }
    return tuple(reason for reason, applies in reasons.items() if applies)


def _with_poses(graph: PoseGraph, poses: FloatArray, held: IntArray) -> PoseGraph:
    fixed = np.zeros(len(poses), np.bool_)
    fixed[held] = True
    vertices, edges = graph.vertices, graph.edges
    return PoseGraph.from_arrays(
        vertices.ids,
        vertices.stamps_ns,
        se3.transform(se3.normalise_rotation(poses[:, :3, :3]), poses[:, :3, 3]),
        edges.ends,
        edges.matrices,
        edges.information_matrices,
        edges.kinds,
        frame=graph.frame,
        fixed=fixed,
        producer=graph.metadata.producer_id,
    )


def _covariances(problem: Problem, poses: FloatArray, weights: FloatArray, wanted: IntArray) -> FloatArray:
    """Return marginal covariances ``(k, 6, 6)``: blocks of the inverse Hessian; 0 for fixed poses."""
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
        out[k] = rotate_covariance(whole, poses[row][:3, :3])
    return out

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Chordal initialisation, Gauss-Newton, and graduated non-convexity for wrong loop closures."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_common.geometry.covariance import rotate_covariance
from cdff_common.geometry.robust import GNC_GROWTH, chi_squared_quantile, truncated_weights
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import PoseGraph
from cdff_common.types.pose_graph_ext import ODOMETRY
from cdff_core.dfns.pose_graph_optimization._block_cholesky import factorise, solve
from cdff_core.dfns.pose_graph_optimization._chordal import chordal_poses
from cdff_core.dfns.pose_graph_optimization._least_squares import Solution, minimise, normal_equations
from cdff_core.dfns.pose_graph_optimization._problem import Problem, make_problem
from cdff_core.dfns.pose_graph_optimization.interface import Inputs, Interface, Outputs

#: Maximum number of weight updates, and of Gauss-Newton iterations for each.
_GNC_UPDATES, _GNC_ITERATIONS = 100, 3


class ChordalGaussNewtonConfig(DfnConfig):
    """Parameters of ChordalGaussNewton."""

    initialise: Literal["auto", "given", "chordal"] = Field(
        "auto",
        description=(
            "Initial poses: those of the graph (given), from the measurements alone (chordal), or those of "
            "the smaller cost (auto)"
        ),
    )
    robust: Literal["none", "gnc"] = Field("none", description="gnc rejects wrong loop closures")
    inlier_probability: float = Field(
        0.999, gt=0.5, lt=1, description="Probability that a correct loop closure is accepted"
    )
    max_iterations: int = Field(100, ge=1, le=10_000, description="Maximum number of normal equations solved")
    tolerance: float = Field(1e-8, gt=0, lt=1e-2, description="Relative change of chi2 at convergence")


class ChordalGaussNewton(Interface[ChordalGaussNewtonConfig]):
    """Sparse Gauss-Newton, damped if necessary, with initial poses computed from the measurements.

    Notes
    -----
    The objective is ``sum e' Omega e`` with ``e = Log(T_ab^-1 X_a^-1 X_b)``. From initial poses of odometry,
    Gauss-Newton converges to local minima for long loops, from those of the chordal relaxation it does not
    (Carlone et al. 2015, doi:10.1109/ICRA.2015.7139836). Loop closures that may be wrong are weighted by
    graduated non-convexity of truncated least squares (Yang et al. 2020, doi:10.1109/LRA.2020.2965893);
    odometry and priors always have weight 1.

    A graph extended by a few vertices can start from its previous poses (``initialise: given``); no equation
    is solved if no new edge contradicts them.
    """

    def setup(self) -> None:
        """Compile the kernels, for spatial and for planar graphs."""
        step = np.tile(np.eye(4), (2, 1, 1))
        planar = np.diag([1.0, 1.0, 0.0, 0.0, 0.0, 1.0])
        for information in (np.eye(6), planar):
            graph = PoseGraph.from_arrays(
                range(3),
                [0] * 3,
                np.tile(np.eye(4), (3, 1, 1)),
                [(0, 1), (1, 2)],
                step,
                np.tile(information, (2, 1, 1)),
                [ODOMETRY] * 2,
                frame="map",
            )
            problem = make_problem(graph)
            minimise(problem, chordal_poses(problem, graph.vertices.matrices, np.ones(2)), np.ones(2), 1, 0.0)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the optimised graph; raises InputError and DegenerateGeometryError."""
        cfg = self.config
        problem = make_problem(inputs.graph)
        initial_poses = inputs.graph.vertices.matrices
        wanted_rows = _wanted_rows(inputs)
        weights = np.ones(len(problem.vertex_a))
        if cfg.robust == "gnc" and problem.is_loop.any():
            solution, weights = self._solve_robust(problem, initial_poses)
        else:
            solution = self._minimise(problem, self._initial_poses(problem, initial_poses, np.inf), weights)
        self.reasons = _reasons(problem, solution, weights)
        self.metrics = {
            f"chi2_{name}": float(weights @ problem.squared_errors(poses))
            for name, poses in (("initial", initial_poses), ("final", solution.poses))
        }
        return Outputs(
            graph=_with_poses(inputs.graph, solution.poses, problem.fixed),
            iterations=solution.iterations,
            converged=solution.converged,
            gauge=inputs.graph.vertices.ids[problem.fixed],
            weights=weights,
            covariances=_covariances(problem, solution.poses, weights, wanted_rows),
        )

    def _minimise(
        self, problem: Problem, poses: FloatArray, weights: FloatArray, max_iterations: int | None = None
    ) -> Solution:
        return minimise(
            problem, poses, weights, max_iterations or self.config.max_iterations, self.config.tolerance
        )

    def _initial_poses(self, problem: Problem, poses_of_graph: FloatArray, limit: float) -> FloatArray:
        """Return the configured initial poses with the smallest cost; errors of edges are truncated at
        ``limit``.
        """
        ones = np.ones(len(problem.vertex_a))
        candidates = [] if self.config.initialise == "chordal" else [poses_of_graph]
        if self.config.initialise != "given":
            candidates.append(chordal_poses(problem, poses_of_graph, ones))
            if np.isfinite(limit):
                candidates.append(chordal_poses(problem, poses_of_graph, np.where(problem.is_loop, 0.0, 1.0)))
        costs = [np.minimum(problem.squared_errors(poses), limit).sum() for poses in candidates]
        return candidates[int(np.argmin(costs))]

    def _solve_robust(self, problem: Problem, poses_of_graph: FloatArray) -> tuple[Solution, FloatArray]:
        """Return the solution and the weights of the edges; those of loop closures change from 1 to either 0
        or 1.
        """
        limit = chi_squared_quantile(self.config.inlier_probability, len(problem.rows))
        weights = np.ones(len(problem.vertex_a))
        solution = self._minimise(
            problem, self._initial_poses(problem, poses_of_graph, limit), weights, 2 * _GNC_ITERATIONS
        )
        iterations = solution.iterations
        r2 = problem.squared_errors(solution.poses)[problem.is_loop]
        mu = limit / max(2.0 * float(r2.max()) - limit, 1e-9 * limit)
        for _ in range(_GNC_UPDATES):
            if r2.max() <= limit or mu > 1e6:
                break
            weights[problem.is_loop] = loop_weights = truncated_weights(r2, limit, mu)
            solution = self._minimise(problem, solution.poses, weights, _GNC_ITERATIONS)
            iterations += solution.iterations
            r2 = problem.squared_errors(solution.poses)[problem.is_loop]
            if np.all((loop_weights < 1e-4) | (loop_weights > 1.0 - 1e-4)):
                break
            mu *= GNC_GROWTH
        weights[problem.is_loop] = (r2 <= limit).astype(np.float64)
        final = self._minimise(problem, solution.poses, weights)
        return Solution(final.poses, final.chi2, iterations + final.iterations, final.converged), weights


def _wanted_rows(inputs: Inputs) -> IntArray:
    """Return the rows of the vertices whose covariance is requested; raises InputError for an unknown id."""
    ids = inputs.graph.vertices.ids
    wanted = np.asarray(() if inputs.wanted is None else inputs.wanted, np.int64).reshape(-1)
    missing = np.setdiff1d(wanted, ids)
    if missing.size:
        raise InputError(f"wanted: vertex {missing[0]} is not in the graph of {len(ids)} vertices")
    order = np.argsort(ids)
    return order[np.searchsorted(ids[order], wanted)]


def _reasons(problem: Problem, solution: Solution, weights: FloatArray) -> tuple[str, ...]:
    """Return the reasons of a solution that is not an ordinary optimum."""
    rejected = int(np.count_nonzero(weights == 0.0))
    reasons = {
        f"information_repaired:{problem.repaired}": problem.repaired > 0,
        f"components:{problem.components}": problem.components > 1,
        f"loops_rejected:{rejected}": rejected > 0,
        "not_converged": not solution.converged,
    }
    return tuple(reason for reason, applies in reasons.items() if applies)


def _with_poses(graph: PoseGraph, poses: FloatArray, fixed: IntArray) -> PoseGraph:
    """Return the graph with other poses; ``fixed`` are the rows of the fixed vertices."""
    is_fixed = np.zeros(len(poses), np.bool_)
    is_fixed[fixed] = True
    vertices, edges = graph.vertices, graph.edges
    return PoseGraph.from_arrays(
        vertices.ids,
        vertices.stamps_ns,
        poses,
        edges.ends,
        edges.matrices,
        edges.information_matrices,
        edges.kinds,
        frame=graph.frame,
        fixed=is_fixed,
        producer=graph.metadata.producer_id,
    )


def _covariances(problem: Problem, poses: FloatArray, weights: FloatArray, rows: IntArray) -> FloatArray:
    """Return the marginal covariances ``(k, 6, 6)`` of these rows: blocks of the inverse Hessian; 0 for fixed
    poses.
    """
    covariances = np.zeros((len(rows), 6, 6))
    is_free = problem.position[rows] >= 0
    if not is_free.any():
        return covariances
    d = len(problem.rows)
    equations = normal_equations(problem, poses, weights)
    factors = factorise(problem.elimination.fronts, equations.diagonal, equations.lower)
    for k in np.flatnonzero(is_free):
        first = problem.position[rows[k]] * d
        unit = np.zeros((len(problem.free) * d, d))
        unit[first : first + d] = np.eye(d)
        block = solve(factors, unit)[first : first + d]
        covariance = np.zeros((6, 6))
        covariance[np.ix_(problem.rows, problem.rows)] = 0.5 * (block + block.T)
        covariances[k] = rotate_covariance(covariance, poses[rows[k]][:3, :3])
    return covariances

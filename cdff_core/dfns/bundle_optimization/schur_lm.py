# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bundle adjustment by Levenberg-Marquardt with the Schur complement of the points."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field
from scipy.linalg.lapack import dpotrf, dpotri

from cdff_common.arrays import FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import BundleCameras, BundleLenses, BundlePoints, BundleProblem
from cdff_common.types.bundle_ext import FOCAL, K1, K2, K3, PRINCIPAL_POINT, TANGENTIAL
from cdff_common.types.columns import pack_poses
from cdff_core.dfns.bundle_optimization._gauge import Gauge
from cdff_core.dfns.bundle_optimization._kernels import CAUCHY, HUBER, NO_LOSS, POSE, point_covariances
from cdff_core.dfns.bundle_optimization._marginal import marginalised
from cdff_core.dfns.bundle_optimization._solve import Solution, minimised
from cdff_core.dfns.bundle_optimization._system import Estimate, System
from cdff_core.dfns.bundle_optimization.interface import Inputs, Interface, Outputs

_LOSSES = {"none": NO_LOSS, "huber": HUBER, "cauchy": CAUCHY}
#: Relative pivot below which a direction of the scaled system is unconstrained.
_ROUNDING = 1e-12
_FREE = {
    "given": None,
    "fixed": 0,
    "focal": FOCAL,
    "radial": FOCAL | K1 | K2,
    "all": FOCAL | PRINCIPAL_POINT | K1 | K2 | K3 | TANGENTIAL,
}


class SchurLmConfig(DfnConfig):
    """Parameters of SchurLm."""

    loss: Literal["none", "huber", "cauchy"] = Field("none", description="Robust loss of the residuals")
    loss_scale_px: float = Field(
        1.0, gt=0, le=1000, description="Residual above which the loss is no longer quadratic"
    )
    lenses: Literal["given", "fixed", "focal", "radial", "all"] = Field(
        "given",
        description=(
            "Lens parameters that are adjusted: as stated in the problem (given), none (fixed), focal "
            "length (focal), focal length and k1, k2 (radial), or all"
        ),
    )
    max_iterations: int = Field(100, ge=0, le=10_000, description="Maximum number of damped steps")
    tolerance: float = Field(1e-7, gt=0, lt=0.1, description="Relative change of the cost at convergence")
    covariances: Literal["none", "poses", "all"] = Field(
        "all", description="Covariances to compute: none, of the poses, or of poses and points (all)"
    )


class SchurLm(Interface[SchurLmConfig]):
    """Levenberg-Marquardt with the points eliminated; robust losses by reweighting [1]_.

    Where the points are far fewer than the cameras, the poses are eliminated instead. The reduced system is
    dense: its cost grows with the cube of the smaller side, up to some hundreds of cameras or a thousand
    points. The right column of a rectified pair is a third residual. Covariances are ``s2`` times the inverse
    of the normal matrix with the gauge fixed, s2 the weighted sum of squared residuals over the degrees of
    freedom.

    References
    ----------
    .. [1] B. Triggs et al., Bundle Adjustment - A Modern Synthesis, 2000, doi:10.1007/3-540-44480-7_21
    """

    def setup(self) -> None:
        """Compile the kernels."""
        T = np.tile(np.eye(4), (2, 1, 1))
        T[1, 0, 3] = 1.0
        seen = (np.tile([0, 1], 4), np.repeat(np.arange(4), 2))
        X = np.array([[0.0, 0, 5], [1, 0, 6], [0, 1, 7], [1, 1, 8]])
        tiny = BundleProblem.from_arrays(
            T, [1.0, 1, 0, 0], X, seen, np.zeros((8, 2)), frame="frame", fixed=[1, 0]
        )
        system = System.of(tiny, None, NO_LOSS, 1.0)
        at = System.first(tiny)
        minimised(system, at, 1, 1e-3)
        self._covariances(system, at, Gauge.of(system, at), 1.0)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the adjusted problem; raises InputError if the problem is invalid."""
        c, problem = self.config, inputs.problem
        loss = _LOSSES[c.loss]
        system, first = System.of(problem, _FREE[c.lenses], loss, c.loss_scale_px), System.first(problem)
        gauge = Gauge.of(system, first)
        solution = minimised(system, first, c.max_iterations, c.tolerance)
        estimate = gauge.restored(system, first, solution.estimate)
        variance, freedom = self._unit_variance(system, solution, gauge)
        pose_covariances, point_covariances = self._covariances(system, estimate, gauge, variance)
        known = c.covariances == "none" or bool(np.isfinite(pose_covariances).all())
        self._report(solution, variance, freedom, len(system.cam), len(gauge.free), known)
        result = _with(problem, estimate)
        back = np.empty_like(system.order)
        back[system.order] = np.arange(len(back))
        remaining = None
        if inputs.dropped is not None:
            remaining = marginalised(result, np.asarray(inputs.dropped, np.int64), loss, c.loss_scale_px)
        held = [row for row in (gauge.camera, gauge.distant) if row is not None]
        return Outputs(
            problem=result,
            pose_covariances=pose_covariances,
            point_covariances=point_covariances,
            residuals=solution.residuals[back],
            weights=solution.weights[back],
            gauge=problem.cameras.ids[held],
            remaining=remaining,
        )

    @staticmethod
    def _unit_variance(system: System, solution: Solution, gauge: Gauge) -> tuple[float, int]:
        """Return the variance of unit weight (NaN where undefined) and the degrees of freedom."""
        per = 2 + (~np.isnan(system.pixels[:, 2])).astype(int)
        moving = system.size + 3 * int(((system.held == 0) & (np.diff(system.start) > 0)).sum())
        count = round(float((per * solution.weights).sum())) + len(system.prior.offset)
        freedom = count - moving + len(gauge.free)
        square = float((solution.weights * (solution.residuals**2).sum(axis=1)).sum())
        square += float((system.prior.residuals(solution.estimate.R, solution.estimate.c)[0] ** 2).sum())
        return (square / freedom if freedom > 0 else float("nan")), freedom

    def _covariances(
        self, system: System, at: Estimate, gauge: Gauge, variance: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return covariances of poses ``(n, 6, 6)`` and points ``(p, 3, 3)``; NaN where undefined."""
        n, p = len(at.c), len(at.X)
        poses, points = np.full((n, POSE, POSE), np.nan), np.full((p, 3, 3), np.nan)
        if self.config.covariances == "none" or not np.isfinite(variance):
            return poses, points
        r, weights, cost, *_ = system.residuals(at)
        if not np.isfinite(cost):
            return poses, points
        normal = system.normal(at, r, weights)
        S, _, inverses, fine = system.reduced(normal, 0.0)
        C = _inverse(np.tril(S) + np.tril(S, -1).T, gauge.fixed_directions(system, at))
        if C is None:
            return poses, points
        for row, column in enumerate(system.pose_column):
            own = slice(column, column + POSE)
            held = column < 0 or (row == gauge.camera and gauge.fixes_pose)
            poses[row] = 0.0 if held else variance * C[own, own]
        if self.config.covariances == "all":
            points = variance * point_covariances(
                system.start, system.cam, system.columns, system.count, normal.W, inverses, fine, C
            )
            points[system.held != 0] = 0.0
        return poses, points

    def _report(
        self, s: Solution, variance: float, freedom: int, observations: int, free: int, known: bool
    ) -> None:
        self.metrics = {
            "cost_initial": s.cost_initial,
            "cost_final": s.cost_final,
            "rmse_px": float(np.sqrt(2.0 * s.cost_final / max(observations, 1))),
            "robust_cost_initial": s.robust_initial,
            "robust_cost_final": s.robust_final,
            "unit_variance": variance,
            "iterations": float(s.iterations),
            "observations": float(observations),
            "outliers": float((s.weights < 0.25).sum()),
            "gauge_directions": float(free),
        }
        reasons = {
            "not_converged": not s.converged,
            "underdetermined": freedom <= 0,
            f"behind_camera:{s.behind}": s.behind > 0,
            "degenerate:directions_free": freedom > 0 and not known,
        }
        self.reasons = tuple(name for name, applies in reasons.items() if applies)


def _inverse(S: FloatArray, held: FloatArray) -> FloatArray | None:
    """Return the inverse of the reduced system with ``held`` fixed; None if further directions are
    unconstrained.

    With ``N`` an orthonormal basis of ``held``: ``M1 = S + NN'``, then ``M1^-1 - M1^-1 N (N'M1^-1 N)^-1
    N'M1^-1``.
    """
    if not len(S):
        return np.zeros((0, 0))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(S), 1e-300))
    N = np.linalg.qr((held * scale).T)[0]  # in scaled columns
    factor, failed = dpotrf(S * np.outer(scale, scale) + N @ N.T, lower=True, overwrite_a=True)
    if failed or np.diag(factor).min() ** 2 < _ROUNDING:
        return None
    inverse, _ = dpotri(factor, lower=True, overwrite_c=True)
    inverse = np.tril(inverse) + np.tril(inverse, -1).T
    along = inverse @ N
    C = (inverse - along @ np.linalg.solve(N.T @ along, along.T)) * np.outer(scale, scale)
    return np.asarray(0.5 * (C + C.T))


def _with(problem: BundleProblem, at: Estimate) -> BundleProblem:
    c, p = problem.cameras, problem.points
    poses = pack_poses(at.matrices(), "BundleOptimization camera") if len(c.ids) else c.poses
    return replace(
        problem,
        cameras=BundleCameras(c.ids, c.stamps, poses, c.lenses, c.fixed),
        lenses=BundleLenses(at.lenses, problem.lenses.free),
        points=BundlePoints(p.ids, at.X, p.fixed),
    )

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
from cdff_core.dfns.bundle_optimization._marginal import marginalise
from cdff_core.dfns.bundle_optimization._solve import Solution, minimise
from cdff_core.dfns.bundle_optimization._system import Estimate, System
from cdff_core.dfns.bundle_optimization.interface import Inputs, Interface, Outputs

_LOSSES = {"none": NO_LOSS, "huber": HUBER, "cauchy": CAUCHY}
#: Pivot of the scaled system below which a direction is unconstrained.
_MIN_PIVOT = 1e-12
#: Adjusted lens parameters for each value of the parameter ``lenses``; None: those of the problem.
_LENS_FLAGS = {
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

    If the points are far fewer than the cameras, the poses are eliminated instead. The reduced system is
    dense, and the time to solve it grows with the cube of its size: it suits up to some hundreds of cameras,
    or a thousand points. The right column of a rectified pair is a third residual. Covariances are the
    inverse of the normal matrix with the gauge fixed, times the variance of unit weight: the weighted sum of
    squared residuals over the degrees of freedom.

    References
    ----------
    .. [1] B. Triggs et al., Bundle Adjustment - A Modern Synthesis, 2000, doi:10.1007/3-540-44480-7_21
    """

    def setup(self) -> None:
        """Compile the kernels."""
        T = np.tile(np.eye(4), (2, 1, 1))
        T[1, 0, 3] = 1.0
        observations = (np.tile([0, 1], 4), np.repeat(np.arange(4), 2))
        X = np.array([[0.0, 0, 5], [1, 0, 6], [0, 1, 7], [1, 1, 8]])
        problem = BundleProblem.from_arrays(
            T, [1.0, 1, 0, 0], X, observations, np.zeros((8, 2)), frame="frame", fixed=[1, 0]
        )
        system = System.of(problem, None, NO_LOSS, 1.0)
        estimate = System.initial_estimate(problem)
        minimise(system, estimate, 1, 1e-3)
        self._covariances(system, estimate, Gauge.of(system, estimate), 1.0)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the adjusted problem; raises InputError if the problem is invalid."""
        cfg, problem = self.config, inputs.problem
        loss = _LOSSES[cfg.loss]
        system = System.of(problem, _LENS_FLAGS[cfg.lenses], loss, cfg.loss_scale_px)
        initial = System.initial_estimate(problem)
        gauge = Gauge.of(system, initial)
        solution = minimise(system, initial, cfg.max_iterations, cfg.tolerance)
        estimate = gauge.restore(system, initial, solution.estimate)
        variance, degrees_of_freedom = self._unit_variance(system, solution, gauge)
        pose_covariances, point_covariances = self._covariances(system, estimate, gauge, variance)
        has_covariances = cfg.covariances == "none" or bool(np.isfinite(pose_covariances).all())
        self._report(
            solution,
            variance=variance,
            degrees_of_freedom=degrees_of_freedom,
            observations=len(system.cam),
            gauge_directions=len(gauge.free),
            has_covariances=has_covariances,
        )
        result = _apply_estimate(problem, estimate)
        system_row = np.empty_like(system.order)
        system_row[system.order] = np.arange(len(system_row))
        remaining = None
        if inputs.dropped is not None:
            remaining = marginalise(result, np.asarray(inputs.dropped, np.int64), loss, cfg.loss_scale_px)
        gauge_rows = [row for row in (gauge.camera, gauge.distant) if row is not None]
        return Outputs(
            problem=result,
            pose_covariances=pose_covariances,
            point_covariances=point_covariances,
            residuals=solution.residuals[system_row],
            weights=solution.weights[system_row],
            gauge=problem.cameras.ids[gauge_rows],
            remaining=remaining,
        )

    @staticmethod
    def _unit_variance(system: System, solution: Solution, gauge: Gauge) -> tuple[float, int]:
        """Return the variance of unit weight (NaN if undefined) and the degrees of freedom.

        An observation counts with its weight, so that rejected outliers add no degrees of freedom.
        """
        residuals_per_observation = 2 + (~np.isnan(system.pixels[:, 2])).astype(int)
        unknowns = system.size + 3 * int(((system.point_fixed == 0) & (np.diff(system.start) > 0)).sum())
        count = round(float((residuals_per_observation * solution.weights).sum())) + len(system.prior.offset)
        degrees_of_freedom = count - unknowns + len(gauge.free)
        squared_sum = float((solution.weights * (solution.residuals**2).sum(axis=1)).sum())
        squared_sum += float((system.prior.residuals(solution.estimate.R, solution.estimate.c)[0] ** 2).sum())
        variance = squared_sum / degrees_of_freedom if degrees_of_freedom > 0 else float("nan")
        return variance, degrees_of_freedom

    def _covariances(
        self, system: System, estimate: Estimate, gauge: Gauge, variance: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return the covariances of poses ``(n, 6, 6)`` and points ``(p, 3, 3)``; NaN if undefined."""
        n, p = len(estimate.c), len(estimate.X)
        poses, points = np.full((n, POSE, POSE), np.nan), np.full((p, 3, 3), np.nan)
        if self.config.covariances == "none" or not np.isfinite(variance):
            return poses, points
        r, weights, cost, *_ = system.residuals(estimate)
        if not np.isfinite(cost):
            return poses, points
        normal = system.normal(estimate, r, weights)
        S, _, inverses, is_regular = system.eliminate_points(normal, 0.0)
        S = np.tril(S) + np.tril(S, -1).T
        C = _constrained_inverse(S, gauge.zero_variance_directions(system, estimate))
        if C is None:
            return poses, points
        for row, column in enumerate(system.pose_column):
            pose_columns = slice(column, column + POSE)
            is_fixed = column < 0 or (row == gauge.camera and gauge.fixes_pose)
            poses[row] = 0.0 if is_fixed else variance * C[pose_columns, pose_columns]
        if self.config.covariances == "all":
            points = variance * point_covariances(
                system.start, system.cam, system.columns, system.count, normal.W, inverses, is_regular, C
            )
            points[system.point_fixed != 0] = 0.0
        return poses, points

    def _report(
        self,
        solution: Solution,
        *,
        variance: float,
        degrees_of_freedom: int,
        observations: int,
        gauge_directions: int,
        has_covariances: bool,
    ) -> None:
        """Set the metrics, and the reasons of a degraded result."""
        self.metrics = {
            "cost_initial": solution.cost_initial,
            "cost_final": solution.cost_final,
            "rmse_px": float(np.sqrt(2.0 * solution.cost_final / max(observations, 1))),
            "robust_cost_initial": solution.robust_initial,
            "robust_cost_final": solution.robust_final,
            "unit_variance": variance,
            "iterations": float(solution.iterations),
            "observations": float(observations),
            "outliers": float((solution.weights < 0.25).sum()),
            "gauge_directions": float(gauge_directions),
        }
        reasons = {
            "not_converged": not solution.converged,
            "underdetermined": degrees_of_freedom <= 0,
            f"behind_camera:{solution.behind}": solution.behind > 0,
            "degenerate:directions_free": degrees_of_freedom > 0 and not has_covariances,
        }
        self.reasons = tuple(name for name, applies in reasons.items() if applies)


def _constrained_inverse(S: FloatArray, fixed: FloatArray) -> FloatArray | None:
    """Return the inverse of S under the constraint that steps along the rows of ``fixed`` are 0.

    Returns None if further directions are unconstrained. With ``N`` an orthonormal basis of these rows and
    ``M = S + N N'``, the inverse is ``M^-1 - M^-1 N (N' M^-1 N)^-1 N' M^-1``.
    """
    if not len(S):
        return np.zeros((0, 0))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(S), 1e-300))
    N = np.linalg.qr((fixed * scale).T)[0]  # in the scaled columns of S
    factor, failed = dpotrf(S * np.outer(scale, scale) + N @ N.T, lower=True, overwrite_a=True)
    if failed or np.diag(factor).min() ** 2 < _MIN_PIVOT:
        return None
    inverse, _ = dpotri(factor, lower=True, overwrite_c=True)
    inverse = np.tril(inverse) + np.tril(inverse, -1).T
    inverse_N = inverse @ N
    C = (inverse - inverse_N @ np.linalg.solve(N.T @ inverse_N, inverse_N.T)) * np.outer(scale, scale)
    return np.asarray(0.5 * (C + C.T))


def _apply_estimate(problem: BundleProblem, estimate: Estimate) -> BundleProblem:
    """Return the problem with the values of an estimate."""
    c, p = problem.cameras, problem.points
    poses = pack_poses(estimate.matrices(), "BundleOptimization camera") if len(c.ids) else c.poses
    return replace(
        problem,
        cameras=BundleCameras(c.ids, c.stamps, poses, c.lenses, c.fixed),
        lenses=BundleLenses(estimate.lenses, problem.lenses.free),
        points=BundlePoints(p.ids, estimate.X, p.fixed),
    )

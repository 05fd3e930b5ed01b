# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bundle adjustment problem as arrays ordered by point, and its residuals and normal equations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from cdff_common.arrays import BoolArray, ByteArray, FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.types import BundleProblem
from cdff_common.types.bundle_ext import FOCAL, K1, K2, K3, PRINCIPAL_POINT, TANGENTIAL
from cdff_core.dfns.bundle_optimization._kernels import (
    LENS,
    POSE,
    WIDTH,
    eliminate_points,
    linearise,
    residuals,
)
from cdff_core.dfns.bundle_optimization._prior import Prior

#: For each of the eight columns of a lens (f cx cy k1 k2 k3 p1 p2): the flag that adjusts it, and its index
#: in ``BundleLenses.values``.
_FLAGS = np.array([FOCAL, PRINCIPAL_POINT, PRINCIPAL_POINT, K1, K2, K3, TANGENTIAL, TANGENTIAL])
_VALUE_INDEX = np.array([0, 2, 3, 4, 5, 8, 6, 7])


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Values of all variables.

    Attributes
    ----------
    R, c : ndarray, shape (n, 3, 3), (n, 3)
        Rotations from frame to camera, positions of the cameras.
    lenses : ndarray, shape (l, 10)
        Rows of ``BundleLenses.values``.
    X : ndarray, shape (p, 3)
        Positions of the points.
    """

    R: FloatArray
    c: FloatArray
    lenses: FloatArray
    X: FloatArray

    def matrices(self) -> FloatArray:
        """Return ``T_frame_camera (n, 4, 4)``."""
        return se3.transform(np.swapaxes(self.R, 1, 2), self.c)


class Residuals(NamedTuple):
    """Residuals and costs of an estimate.

    Attributes
    ----------
    residuals, weights : ndarray, shape (m, 3), (m,)
        Predicted minus observed coordinates in pixels and weights of the robust loss.
    minimised_cost, plain_cost : float
        Half the sum of squared residuals with robust loss and prior, and without both.
    behind : int
        Number of observations of points behind their camera.
    """

    residuals: FloatArray
    weights: FloatArray
    minimised_cost: float
    plain_cost: float
    behind: int


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """Normal equations of cameras and lenses (H, g), of points (Hp, gp), and their coupling (W).

    See ``_kernels`` for the shapes.
    """

    H: FloatArray
    g: FloatArray
    Hp: FloatArray
    gp: FloatArray
    W: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class System:
    """Constant data of an adjustment; see ``_kernels`` for the arrays not listed here.

    Attributes
    ----------
    order : ndarray, shape (m,)
        Row in the problem of each observation; observations are ordered by point.
    pose_column, lens_columns : ndarray, shape (n,), (l, 8)
        Column in H of the first of six pose components, and of each lens parameter; -1 if fixed.
    size : int
        Number of columns of H: adjusted components of poses and lenses.
    point_fixed : ndarray, shape (p,)
        Not 0 for points that are not adjusted.
    loss, scale : int and float
        Robust loss of ``_kernels`` and its scale in pixels.
    prior_columns : ndarray, shape (6k,)
        Columns in H of the cameras of the prior.
    """

    order: IntArray
    start: IntArray
    cam: IntArray
    pt: IntArray
    pixels: FloatArray
    lens: IntArray
    columns: IntArray
    count: IntArray
    pose_column: IntArray
    lens_columns: IntArray
    size: int
    point_fixed: ByteArray
    loss: int
    scale: float
    prior_columns: IntArray
    prior: Prior

    @classmethod
    def of(cls, problem: BundleProblem, lens_flags: int | None, loss: int, scale: float) -> System:
        """Return the system of a problem.

        ``lens_flags`` replaces the flags of adjusted parameters of all lenses. Raises InputError if the
        problem has neither observations nor a prior, or invalid numbers.
        """
        cameras, points, observations = problem.cameras, problem.points, problem.observations
        finite = np.isfinite(observations.pixels[:, :2]).all() and np.isfinite(points.positions).all()
        has_residuals = len(observations.cameras) or len(problem.prior.cameras)
        if not has_residuals or not finite or not (problem.lenses.values[:, :2] > 0.0).all():
            raise InputError(
                "problem: expected observations or a prior, finite pixels and points, focal lengths above 0"
            )
        order = np.argsort(observations.points, kind="stable")
        flags = (
            np.full(len(problem.lenses.values), lens_flags)
            if lens_flags is not None
            else problem.lenses.free.astype(np.int64)
        )
        n = len(cameras.ids)
        pose_column = np.full(n, -1, np.int64)
        adjusted_cameras = np.flatnonzero(cameras.fixed == 0)
        pose_column[adjusted_cameras] = POSE * np.arange(len(adjusted_cameras))
        is_adjusted = (flags[:, None] & _FLAGS) != 0
        is_used = np.zeros(len(flags), bool)
        is_used[cameras.lenses[np.unique(observations.cameras)]] = True
        is_adjusted &= is_used[:, None]
        lens_columns = np.full((len(flags), LENS), -1, np.int64)
        lens_columns[is_adjusted] = POSE * len(adjusted_cameras) + np.arange(int(is_adjusted.sum()))
        size = POSE * len(adjusted_cameras) + int(is_adjusted.sum())
        columns, count = np.zeros((n, WIDTH, 2), np.int64), np.zeros(n, np.int64)
        for i in range(n):
            column_pairs = [(j, pose_column[i] + j) for j in range(POSE)] if pose_column[i] >= 0 else []
            column_pairs += [
                (POSE + j, col) for j, col in enumerate(lens_columns[cameras.lenses[i]]) if col >= 0
            ]
            count[i] = len(column_pairs)
            columns[i, : count[i]] = np.array(column_pairs, np.int64).reshape(-1, 2)
        prior = Prior.of(problem)
        if (pose_column[prior.cameras] < 0).any():
            raise InputError("problem: a camera of the prior is fixed")
        prior_columns = (pose_column[prior.cameras, None] + np.arange(POSE)).reshape(-1)
        pt = observations.points[order].astype(np.int64)
        return cls(
            order=order,
            start=np.r_[0, np.cumsum(np.bincount(pt, minlength=len(points.ids)))].astype(np.int64),
            cam=observations.cameras[order].astype(np.int64),
            pt=pt,
            pixels=np.ascontiguousarray(observations.pixels[order]),
            lens=cameras.lenses.astype(np.int64),
            columns=columns,
            count=count,
            pose_column=pose_column,
            lens_columns=lens_columns,
            size=size,
            point_fixed=np.array(points.fixed),
            loss=loss,
            scale=scale,
            prior_columns=prior_columns,
            prior=prior,
        )

    @staticmethod
    def initial_estimate(problem: BundleProblem) -> Estimate:
        """Return the cameras, lenses and points of a problem as the estimate before the first iteration."""
        T = problem.cameras.matrices
        return Estimate(
            np.ascontiguousarray(np.swapaxes(T[:, :3, :3], 1, 2)),
            np.ascontiguousarray(T[:, :3, 3]),
            np.array(problem.lenses.values),
            np.array(problem.points.positions),
        )

    def _arrays(self, e: Estimate) -> Any:
        return self.cam, self.pt, self.pixels, self.lens, e.R, e.c, e.lenses, e.X

    def residuals(self, e: Estimate) -> Residuals:
        """Return the residuals and costs of an estimate."""
        r, weights, robust, plain, behind = residuals(  # type: ignore[call-arg]
            *self._arrays(e), self.loss, self.scale
        )
        prior_residuals, _ = self.prior.residuals(e.R, e.c)
        prior_cost = 0.5 * float(prior_residuals @ prior_residuals)
        return Residuals(r, weights, robust + prior_cost, plain, behind)

    def normal(self, e: Estimate, r: FloatArray, weights: FloatArray) -> NormalEquations:
        """Return the normal equations at an estimate, including the prior."""
        H, g, Hp, gp, W = linearise(  # type: ignore[call-arg]
            *self._arrays(e), self.columns, self.count, r, weights, self.point_fixed, self.size
        )
        if len(self.prior_columns):
            prior_residuals, prior_derivatives = self.prior.residuals(e.R, e.c)
            g[self.prior_columns] += prior_derivatives.T @ prior_residuals
            H[np.ix_(self.prior_columns, self.prior_columns)] += np.tril(
                prior_derivatives.T @ prior_derivatives
            )
        return NormalEquations(H, g, Hp, gp, W)

    def eliminate_points(
        self, n: NormalEquations, damping: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """Return the Schur complement of the points, see ``_kernels.eliminate_points``."""
        return eliminate_points(
            self.start, self.cam, self.columns, self.count, n.H, n.g, n.Hp, n.gp, n.W, damping
        )

    def apply_step(self, e: Estimate, step: FloatArray, point_step: FloatArray) -> Estimate:
        """Return the estimate after steps ``(size,)`` of cameras and lenses and ``(p, 3)`` of points."""
        is_adjusted = self.pose_column >= 0
        pose_step = step[self.pose_column[is_adjusted, None] + np.arange(POSE)]
        R, c, lenses = e.R.copy(), e.c.copy(), e.lenses.copy()
        c[is_adjusted] += pose_step[:, :3]
        R[is_adjusted] = R[is_adjusted] @ np.swapaxes(se3.exp_so3(pose_step[:, 3:]), 1, 2)
        aspect_ratio = lenses[:, 1] / lenses[:, 0]  # fy / fx, which is constant
        for row, j in zip(*np.nonzero(self.lens_columns >= 0), strict=True):
            lenses[row, _VALUE_INDEX[j]] += step[self.lens_columns[row, j]]
        lenses[:, 1] = aspect_ratio * lenses[:, 0]
        return replace(e, R=R, c=c, lenses=lenses, X=e.X + point_step)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bundle as arrays ordered by point, its columns, and its normal equations at an estimate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cdff_common.arrays import BoolArray, ByteArray, FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.types import BundleProblem
from cdff_common.types.bundle_ext import FOCAL, K1, K2, K3, PRINCIPAL_POINT, TANGENTIAL
from cdff_core.dfns.bundle_optimization._kernels import LENS, POSE, WIDTH, linearised, reduced, residuals
from cdff_core.dfns.bundle_optimization._prior import Prior

#: Flags of the eight columns of a lens (f cx cy k1 k2 k3 p1 p2), and their indices in the values of a lens.
_FLAGS = np.array([FOCAL, PRINCIPAL_POINT, PRINCIPAL_POINT, K1, K2, K3, TANGENTIAL, TANGENTIAL])
_VALUE_INDEX = np.array([0, 2, 3, 4, 5, 8, 6, 7])


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Rotations to camera ``(n, 3, 3)``, positions ``(n, 3)``, lenses ``(l, 10)``, points ``(p, 3)``."""

    R: FloatArray
    c: FloatArray
    lenses: FloatArray
    X: FloatArray

    def matrices(self) -> FloatArray:
        """``T_frame_camera (n, 4, 4)``."""
        return se3.transform(np.swapaxes(self.R, 1, 2), self.c)


@dataclass(frozen=True, slots=True, eq=False)
class Normal:
    """Normal equations of cameras and lenses, of points, and their coupling."""

    H: FloatArray
    g: FloatArray
    Hp: FloatArray
    gp: FloatArray
    W: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class System:
    """Constant data of an adjustment.

    Attributes
    ----------
    order : ndarray, shape (m,)
        Rows of the problem's observations, by point.
    start : ndarray, shape (p + 1,)
        First observation of each point.
    columns : ndarray, shape (n, WIDTH, 2)
        Columns of each camera's observations, in J and in H; the first ``count`` are used.
    pose_column, lens_columns : ndarray, shape (n,), (l, 8)
        First column in H of a pose, columns of a lens; -1 where fixed.
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
    held: ByteArray
    loss: int
    scale: float
    prior_columns: IntArray
    prior: Prior

    @classmethod
    def of(cls, problem: BundleProblem, free: int | None, loss: int, scale: float) -> System:
        """Return the system of a problem; ``free`` overrides the flags of the lenses. Raises InputError."""
        cameras, points, seen = problem.cameras, problem.points, problem.observations
        finite = np.isfinite(seen.pixels[:, :2]).all() and np.isfinite(points.positions).all()
        prior_residuals = len(seen.cameras) or len(problem.prior.cameras)
        if not prior_residuals or not finite or not (problem.lenses.values[:, :2] > 0.0).all():
            raise InputError(
                "problem: expected observations or a prior, finite pixels and points, focal lengths above 0"
            )
        order = np.argsort(seen.points, kind="stable")
        flags = (
            np.full(len(problem.lenses.values), free)
            if free is not None
            else problem.lenses.free.astype(np.int64)
        )
        n = len(cameras.ids)
        pose_column = np.full(n, -1, np.int64)
        moving = np.flatnonzero(cameras.fixed == 0)
        pose_column[moving] = POSE * np.arange(len(moving))
        open_ = (flags[:, None] & _FLAGS) != 0
        used = np.zeros(len(flags), bool)
        used[cameras.lenses[np.unique(seen.cameras)]] = True
        open_ &= used[:, None]
        lens_columns = np.full((len(flags), LENS), -1, np.int64)
        lens_columns[open_] = POSE * len(moving) + np.arange(int(open_.sum()))
        size = POSE * len(moving) + int(open_.sum())
        columns, count = np.zeros((n, WIDTH, 2), np.int64), np.zeros(n, np.int64)
        for i in range(n):
            own = [(j, pose_column[i] + j) for j in range(POSE)] if pose_column[i] >= 0 else []
            own += [(POSE + j, col) for j, col in enumerate(lens_columns[cameras.lenses[i]]) if col >= 0]
            columns[i, : len(own)], count[i] = np.array(own, np.int64).reshape(-1, 2), len(own)
        prior = Prior.of(problem)
        if (pose_column[prior.cameras] < 0).any():
            raise InputError("problem: a camera of the prior is fixed")
        prior_columns = (pose_column[prior.cameras, None] + np.arange(POSE)).reshape(-1)
        pt = seen.points[order].astype(np.int64)
        return cls(
            order,
            np.r_[0, np.cumsum(np.bincount(pt, minlength=len(points.ids)))].astype(np.int64),
            seen.cameras[order].astype(np.int64),
            pt,
            np.ascontiguousarray(seen.pixels[order]),
            cameras.lenses.astype(np.int64),
            columns,
            count,
            pose_column,
            lens_columns,
            size,
            np.array(points.fixed),
            loss,
            scale,
            prior_columns,
            prior,
        )

    @staticmethod
    def first(problem: BundleProblem) -> Estimate:
        """Return the initial estimate of a problem."""
        T = problem.cameras.matrices
        return Estimate(
            np.ascontiguousarray(np.swapaxes(T[:, :3, :3], 1, 2)),
            np.ascontiguousarray(T[:, :3, 3]),
            np.array(problem.lenses.values),
            np.array(problem.points.positions),
        )

    def _arrays(self, e: Estimate) -> Any:
        return self.cam, self.pt, self.pixels, self.lens, e.R, e.c, e.lenses, e.X

    def residuals(self, e: Estimate) -> tuple[FloatArray, FloatArray, float, float, int]:
        """Return residuals, weights, robust cost and plain cost, and the number of points behind their
        camera.

        The robust cost includes the prior, the plain one does not.
        """
        r, weights, robust, plain, behind = residuals(*self._arrays(e), self.loss, self.scale)  # type: ignore[call-arg]
        prior_residuals, _ = self.prior.residuals(e.R, e.c)
        return r, weights, robust + 0.5 * float(prior_residuals @ prior_residuals), plain, behind

    def normal(self, e: Estimate, r: FloatArray, weights: FloatArray) -> Normal:
        """Return the normal equations with the prior."""
        H, g, Hp, gp, W = linearised(  # type: ignore[call-arg]
            *self._arrays(e), self.columns, self.count, r, weights, self.held, self.size
        )
        if len(self.prior_columns):
            prior_residuals, prior_derivatives = self.prior.residuals(e.R, e.c)
            g[self.prior_columns] += prior_derivatives.T @ prior_residuals
            H[np.ix_(self.prior_columns, self.prior_columns)] += np.tril(
                prior_derivatives.T @ prior_derivatives
            )
        return Normal(H, g, Hp, gp, W)

    def reduced(self, normal: Normal, damping: float) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """Return the Schur complement of the points."""
        n = normal
        return reduced(self.start, self.cam, self.columns, self.count, n.H, n.g, n.Hp, n.gp, n.W, damping)

    def moved(self, e: Estimate, step: FloatArray, point_step: FloatArray) -> Estimate:
        """Return the estimate after a step."""
        free = self.pose_column >= 0
        d = step[self.pose_column[free, None] + np.arange(POSE)]
        R, c, lenses = e.R.copy(), e.c.copy(), e.lenses.copy()
        c[free] += d[:, :3]
        R[free] = R[free] @ np.swapaxes(se3.exp_so3(d[:, 3:]), 1, 2)
        ratio = lenses[:, 1] / lenses[:, 0]
        for row, j in zip(*np.nonzero(self.lens_columns >= 0), strict=True):
            lenses[row, _VALUE_INDEX[j]] += step[self.lens_columns[row, j]]
        lenses[:, 1] = ratio * lenses[:, 0]
        return replace(e, R=R, c=c, lenses=lenses, X=e.X + point_step)

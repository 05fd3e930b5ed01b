# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A bundle as arrays ordered by point, its columns, and its normal equations at an estimate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.types import BundleProblem
from cdff_common.types.bundle_ext import FOCAL, K1, K2, K3, PRINCIPAL_POINT, TANGENTIAL
from cdff_core.dfns.bundle_optimization._kernels import LENS, POSE, WIDTH, linearised, reduced, residuals
from cdff_core.dfns.bundle_optimization._prior import Prior

Float = NDArray[np.float64]
Int = NDArray[np.int64]
#: Flag of each of the lens's eight columns: f cx cy k1 k2 k3 p1 p2; and where they lie in a lens's values.
_FLAGS = np.array([FOCAL, PRINCIPAL_POINT, PRINCIPAL_POINT, K1, K2, K3, TANGENTIAL, TANGENTIAL])
_PLACES = np.array([0, 2, 3, 4, 5, 8, 6, 7])


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Rotations frame to camera ``(n, 3, 3)``, positions ``(n, 3)``, lenses ``(l, 10)``, points ``(p, 3)``."""

    R: Float
    c: Float
    lenses: Float
    X: Float

    def matrices(self) -> Float:
        """``T_frame_camera (n, 4, 4)``."""
        return se3.transform(np.swapaxes(self.R, 1, 2), self.c)


@dataclass(frozen=True, slots=True, eq=False)
class Normal:
    """Normal equations: of cameras and lenses, of points, and what couples them."""

    H: Float
    g: Float
    Hp: Float
    gp: Float
    W: Float


@dataclass(frozen=True, slots=True, eq=False)
class System:
    """What does not change while a bundle is adjusted.

    Attributes
    ----------
    order : ndarray, shape (m,)
        Rows of the problem's observations, by point.
    start : ndarray, shape (p + 1,)
        Where each point's observations begin.
    columns : ndarray, shape (n, WIDTH, 2)
        Of each camera's observations, in J and in H; the first ``count`` of them.
    pose_column, lens_columns : ndarray, shape (n,), (l, 8)
        First column in H of a pose, columns of a lens; -1 where held.
    """

    order: Int
    start: Int
    cam: Int
    pt: Int
    pixels: Float
    lens: Int
    columns: Int
    count: Int
    pose_column: Int
    lens_columns: Int
    size: int
    held: NDArray[np.uint8]
    loss: int
    scale: float
    prior_columns: Int
    prior: Prior

    @classmethod
    def of(cls, problem: BundleProblem, free: int | None, loss: int, scale: float) -> System:
        """Order a problem; ``free`` goes before what the lenses say where it is given. Raises InputError."""
        cameras, points, seen = problem.cameras, problem.points, problem.observations
        finite = np.isfinite(seen.pixels[:, :2]).all() and np.isfinite(points.positions).all()
        said = len(seen.cameras) or len(problem.prior.cameras)
        if not said or not finite or not (problem.lenses.values[:, :2] > 0.0).all():
            raise InputError(
                "problem: expected observations or a prior, finite pixels and points, focal lengths above 0"
            )
        order = np.argsort(seen.points, kind="stable")
        flags = np.full(len(problem.lenses.values), free) if free is not None else problem.lenses.free.astype(np.int64)
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
            order, np.r_[0, np.cumsum(np.bincount(pt, minlength=len(points.ids)))].astype(np.int64),
            seen.cameras[order].astype(np.int64), pt, np.ascontiguousarray(seen.pixels[order]),
            cameras.lenses.astype(np.int64), columns, count, pose_column, lens_columns, size,
            np.array(points.fixed), loss, scale, prior_columns, prior,
        )  # fmt: skip

    @staticmethod
    def first(problem: BundleProblem) -> Estimate:
        """Where the problem begins."""
        T = problem.cameras.matrices
        return Estimate(
            np.ascontiguousarray(np.swapaxes(T[:, :3, :3], 1, 2)), np.ascontiguousarray(T[:, :3, 3]),
            np.array(problem.lenses.values), np.array(problem.points.positions),
        )  # fmt: skip

    def _arrays(self, e: Estimate) -> tuple[Any, ...]:
        return self.cam, self.pt, self.pixels, self.lens, e.R, e.c, e.lenses, e.X

    def residuals(self, e: Estimate) -> tuple[Float, Float, float, float, int]:
        """Residuals, weights, robust cost with the prior's, plain cost without, points behind their camera."""
        r, weights, robust, plain, behind = residuals(*self._arrays(e), self.loss, self.scale)
        said, _ = self.prior.residuals(e.R, e.c)
        return r, weights, robust + 0.5 * float(said @ said), plain, behind

    def normal(self, e: Estimate, r: Float, weights: Float) -> Normal:
        """Normal equations, the prior's included."""
        H, g, Hp, gp, W = linearised(*self._arrays(e), self.columns, self.count, r, weights, self.held, self.size)
        if len(self.prior_columns):
            said, slopes = self.prior.residuals(e.R, e.c)
            g[self.prior_columns] += slopes.T @ said
            H[np.ix_(self.prior_columns, self.prior_columns)] += np.tril(slopes.T @ slopes)
        return Normal(H, g, Hp, gp, W)

    def reduced(self, normal: Normal, damping: float) -> tuple[Float, Float, Float, NDArray[np.bool_]]:
        """Schur complement of the points."""
        n = normal
        return reduced(self.start, self.cam, self.columns, self.count, n.H, n.g, n.Hp, n.gp, n.W, damping)

    def moved(self, e: Estimate, step: Float, point_step: Float) -> Estimate:
        """The estimate after a step."""
        free = self.pose_column >= 0
        d = step[self.pose_column[free, None] + np.arange(POSE)]
        R, c, lenses = e.R.copy(), e.c.copy(), e.lenses.copy()
        c[free] += d[:, :3]
        R[free] = R[free] @ np.swapaxes(se3.exp_so3(d[:, 3:]), 1, 2)
        ratio = lenses[:, 1] / lenses[:, 0]
        for row, j in zip(*np.nonzero(self.lens_columns >= 0), strict=True):
            lenses[row, _PLACES[j]] += step[self.lens_columns[row, j]]
        lenses[:, 1] = ratio * lenses[:, 0]
        return replace(e, R=R, c=c, lenses=lenses, X=e.X + point_step)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Initial poses from the measurements alone: rotations by the chordal relaxation, then translations."""

from __future__ import annotations

import numpy as np
from numba import njit

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.geometry import se3
from cdff_core.dfns.pose_graph_optimization._block_cholesky import factorise, solve
from cdff_core.dfns.pose_graph_optimization._problem import Problem


def chordal_poses(problem: Problem, poses: FloatArray, weights: FloatArray) -> FloatArray:
    """Return initial poses ``(n, 4, 4)``; those of the fixed vertices are taken from ``poses``.

    Martinec and Pajdla (2007), doi:10.1109/CVPR.2007.383115, compared by Carlone et al. (2015),
    doi:10.1109/ICRA.2015.7139836: ``sum kappa |R_b - R_a R_ab|^2`` is linear in the entries of the rotations;
    its solution is projected to the nearest rotations, and ``sum tau |t_b - t_a - R_a t_ab|^2`` is minimised
    over the translations. kappa and tau are isotropic approximations of the information. Edges of weight 0
    are ignored.
    """
    kappa, tau = (weights * w for w in _isotropic(problem))
    Z, fixed = problem.measured, problem.fixed
    # Row i of R_b is row i of R_a times R_ab: three unknowns for each pose, and one right-hand side for each
    # row. A prior has the value R_ab.
    blocks = np.ascontiguousarray(np.swapaxes(Z[:, :3, :3], 1, 2))
    offsets = np.where(problem.is_prior[:, None, None], blocks, 0.0)
    rows = np.zeros((len(poses), 3, 3))
    rows[fixed] = np.swapaxes(poses[fixed, :3, :3], 1, 2)
    _solve_linear(problem, blocks, kappa, offsets, rows)
    R = poses[:, :3, :3].copy()
    R[problem.free] = se3.normalise_rotation(np.swapaxes(rows[problem.free], 1, 2))
    rotated = (R[problem.vertex_a] @ Z[:, :3, 3, None])[..., 0]
    offsets = np.where(problem.is_prior[:, None], Z[:, :3, 3], rotated)[:, None, :]
    t = np.zeros((len(poses), 1, 3))
    t[fixed, 0] = poses[fixed, :3, 3]
    _solve_linear(problem, np.ones((len(Z), 1, 1)), tau, offsets, t)
    return se3.transform(R, t[:, 0])


def _solve_linear(
    problem: Problem, blocks: FloatArray, weights: FloatArray, offsets: FloatArray, x: FloatArray
) -> None:
    """Write to the unknowns ``x (n, k, r)`` of free vertices the minimum of
    ``sum weight |x_b - block x_a - offset|^2``, with ``weight |x_a - offset|^2`` of each prior.

    ``x`` of the fixed vertices is given; blocks are ``(m, k, k)``, offsets ``(m, k, r)``.
    """
    if not len(problem.free):
        return
    k, fronts = x.shape[1], problem.elimination.fronts
    diagonal, right = np.zeros(len(problem.free)), np.zeros((len(problem.free), k, x.shape[2]))
    lower = np.zeros((len(fronts.slot_row), k, k))
    _accumulate(
        problem.vertex_a,
        problem.vertex_b,
        blocks,
        weights,
        offsets,
        x,
        problem.position,
        problem.slot,
        problem.is_a_later,
        diagonal,
        lower,
        right,
    )
    # A small term keeps the system regular if vertices have no measurements.
    diagonal += 1e-12 * max(float(diagonal.max()), 1e-300)
    factors = factorise(fronts, diagonal[:, None, None] * np.eye(k), lower)
    solution = solve(factors, right.reshape(-1, x.shape[2])).reshape(right.shape)
    x[problem.free] = solution[problem.position[problem.free]]


@njit(cache=True)
def _accumulate(
    a: IntArray,
    b: IntArray,
    blocks: FloatArray,
    weights: FloatArray,
    offsets: FloatArray,
    x: FloatArray,
    position: IntArray,
    slot: IntArray,
    is_a_later: BoolArray,
    diagonal: FloatArray,
    lower: FloatArray,
    right: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Add the normal equations of ``_solve_linear``, for orthogonal blocks, in the order of elimination."""
    for m in range(len(a)):
        p, q, w, B = position[a[m]], position[b[m]], weights[m], blocks[m]
        if q >= 0:
            diagonal[q] += w
            right[q] += w * offsets[m]
            if p < 0:
                right[q] += w * np.dot(B, x[a[m]])
        if a[m] == b[m]:
            continue
        if p >= 0:
            diagonal[p] += w
            right[p] -= w * np.dot(B.T, offsets[m])
            if q < 0:
                right[p] += w * np.dot(B.T, x[b[m]])
        if p >= 0 and q >= 0:
            lower[slot[m]] -= w * (B.T if is_a_later[m] else B)


def _isotropic(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """Return the mean information of the rotations and of the translations of each edge."""
    diagonal = np.diagonal(problem.information, axis1=1, axis2=2)
    split = 3 if len(problem.rows) == 6 else 2
    floor = 1e-9 * max(float(diagonal.max(initial=0.0)), 1e-300)
    return np.maximum(diagonal[:, split:].mean(axis=1), floor), np.maximum(
        diagonal[:, :split].mean(axis=1), floor
    )

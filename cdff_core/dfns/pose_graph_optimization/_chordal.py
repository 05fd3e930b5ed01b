# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Initial poses from the measurements alone: rotations by the chordal relaxation, then translations."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import splu

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry import se3
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
    n = len(poses)
    prior = problem.is_prior
    a, b = problem.vertex_a[~prior], problem.vertex_b[~prior]
    Z = problem.measured[~prior]
    # Row i of R_b is row i of R_a times R_ab: three unknowns for each pose, and one right-hand side for each
    # row.
    blocks = np.swapaxes(Z[:, :3, :3], 1, 2)
    fixed_rotations = poses[problem.fixed, :3, :3]
    rows = _solve_linear(
        n,
        problem,
        _Edges(a, b, blocks, kappa[~prior]),
        np.zeros((len(a), 3, 3)),
        _Priors(problem.vertex_a[prior], kappa[prior], np.swapaxes(problem.measured[prior, :3, :3], 1, 2)),
        np.swapaxes(fixed_rotations, 1, 2),
    )
    R = se3.normalise_rotation(np.swapaxes(rows, 1, 2))
    R[problem.fixed] = fixed_rotations
    translation = (R[a] @ Z[:, :3, 3, None])[..., 0]
    t = _solve_linear(
        n,
        problem,
        _Edges(a, b, np.ones((len(a), 1, 1)), tau[~prior]),
        translation[:, None, :],
        _Priors(problem.vertex_a[prior], tau[prior], problem.measured[prior, None, :3, 3]),
        poses[problem.fixed, None, :3, 3],
    )
    return se3.transform(R, t[:, 0])


class _Edges:
    """Terms ``weight |x_b - block x_a - offset|^2`` of the objective."""

    def __init__(self, a: IntArray, b: IntArray, blocks: FloatArray, weights: FloatArray) -> None:
        self.a, self.b, self.blocks, self.weights = a, b, blocks, weights


class _Priors:
    """Terms ``weight |x_a - value|^2`` of the objective."""

    def __init__(self, a: IntArray, weights: FloatArray, values: FloatArray) -> None:
        self.a, self.weights, self.values = a, weights, values


def _solve_linear(
    n: int, problem: Problem, edges: _Edges, offsets: FloatArray, priors: _Priors, fixed: FloatArray
) -> FloatArray:
    """Return the unknowns ``(n, k, r)`` that minimise the sum of all terms; those of fixed vertices are
    ``fixed (g, k, r)``. The offsets are those of the edges, ``(m, k, r)``.
    """
    k, r = offsets.shape[1:] if len(offsets) else fixed.shape[1:]
    m, p = len(edges.a), len(priors.a)
    edge_scale, prior_scale = np.sqrt(edges.weights)[:, None, None], np.sqrt(priors.weights)[:, None, None]
    eye = np.broadcast_to(np.eye(k), (m, k, k))
    equation = np.arange((m + p) * k).reshape(m + p, k, 1)
    values = np.concatenate(
        [
            -(edges.blocks * edge_scale).ravel(),
            (eye * edge_scale).ravel(),
            (np.broadcast_to(np.eye(k), (p, k, k)) * prior_scale).ravel(),
        ]
    )
    equations = np.concatenate(
        [
            np.broadcast_to(equation[rows], (len(equation[rows]), k, k)).ravel()
            for rows in (slice(0, m), slice(0, m), slice(m, m + p))
        ]
    )
    unknowns = np.concatenate([_block_columns(i, k) for i in (edges.a, edges.b, priors.a)])
    A = coo_matrix((values, (equations, unknowns)), shape=((m + p) * k, n * k)).tocsc()
    right = np.concatenate([offsets * edge_scale, priors.values * prior_scale]).reshape(-1, r)
    x = np.zeros((n, k, r))
    x[problem.fixed] = fixed
    free = np.setdiff1d(np.arange(n), problem.fixed)
    columns = (free[:, None] * k + np.arange(k)).ravel()
    B = A[:, columns]
    normal = csc_matrix(B.T @ B)
    # A small diagonal term keeps the system regular if vertices have no measurements.
    normal.setdiag(normal.diagonal() + 1e-12 * max(float(normal.diagonal().max(initial=0.0)), 1e-300))
    if len(free):
        x[free] = factorise(normal).solve(B.T @ (right - A @ x.reshape(-1, r))).reshape(-1, k, r)
    return x


def _block_columns(vertices: IntArray, k: int) -> IntArray:
    """Return the column of each entry of the blocks ``(len, k, k)`` of these vertices, flattened."""
    return np.broadcast_to((vertices[:, None] * k + np.arange(k))[:, None, :], (len(vertices), k, k)).ravel()


def factorise(matrix: csc_matrix) -> Any:
    """Return the sparse factors of a positive definite matrix; raises RuntimeError if it is singular."""
    return splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})


def _isotropic(problem: Problem) -> tuple[FloatArray, FloatArray]:
    """Return the mean information of the rotations and of the translations of each edge."""
    diagonal = np.diagonal(problem.information, axis1=1, axis2=2)
    split = 3 if len(problem.rows) == 6 else 2
    floor = 1e-9 * max(float(diagonal.max(initial=0.0)), 1e-300)
    return np.maximum(diagonal[:, split:].mean(axis=1), floor), np.maximum(
        diagonal[:, :split].mean(axis=1), floor
    )

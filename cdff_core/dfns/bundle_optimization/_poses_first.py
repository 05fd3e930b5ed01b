# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Step with the poses eliminated instead of the points, for many images of few points.

Some tens of points observed in hundreds of images couple every pose with every other one, so that the reduced
system of cameras is dense; that of the points and lenses is small (Triggs et al. 2000, §6.1).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from cdff_common.arrays import FloatArray, IntArray
from cdff_core.dfns.bundle_optimization._kernels import POSE
from cdff_core.dfns.bundle_optimization._system import Normal, System


def is_smaller(system: System) -> bool:
    """Return whether the points are far fewer unknowns than the poses, and nothing else couples these."""
    poses = POSE * int((system.pose_column >= 0).sum())
    left = system.size - poses + 3 * len(system.held)
    return not len(system.prior_columns) and 2 * left <= poses


def stepped(system: System, normal: Normal, damping: float) -> tuple[FloatArray | None, FloatArray]:
    """Return the steps of cameras and lenses, and of points ``(p, 3)``; None if singular."""
    moving, points = np.flatnonzero(system.pose_column >= 0), len(system.held)
    poses = POSE * len(moving)
    B, C, D = _blocks(system, normal, moving)
    for M in (*B, D):
        M[np.diag_indices_from(M)] += damping * np.clip(np.diagonal(M), 1e-6, 1e32)
    gradient = np.concatenate([normal.g[poses:], normal.gp.reshape(-1)])
    free = np.concatenate([np.ones(system.size - poses, bool), np.repeat(np.diff(system.start) > 0, 3)])
    free[system.size - poses :] &= np.repeat(system.held == 0, 3)
    try:
        solved = np.linalg.solve(B, np.dstack([C, normal.g[:poses].reshape(-1, POSE, 1)])).reshape(poses, -1)
        flat = C.reshape(poses, -1)
        S, b = D - flat.T @ solved[:, :-1], gradient - flat.T @ solved[:, -1]
        rest = np.zeros(len(D))
        rest[free] = -cho_solve(cho_factor(S[np.ix_(free, free)], lower=True), b[free])
    except (LinAlgError, ValueError):
        return None, np.zeros((points, 3))
    step = np.concatenate([-solved[:, -1] - solved[:, :-1] @ rest, rest[: system.size - poses]])
    return (step if np.isfinite(step).all() else None), rest[system.size - poses :].reshape(points, 3)


def _blocks(system: System, n: Normal, moving: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the blocks of the poses ``(n, 6, 6)``, their coupling with lenses and points ``(n, 6, d)``, and
    the blocks ``(d, d)`` of these.
    """
    poses, points = POSE * len(moving), len(system.held)
    lenses = system.size - poses
    own = np.arange(poses).reshape(-1, POSE)
    lower = n.H[own[:, :, None], own[:, None, :]]
    B = np.tril(lower) + np.swapaxes(np.tril(lower, -1), 1, 2)
    row = np.full(len(system.pose_column), -1)
    row[moving] = np.arange(len(moving))
    seen = row[system.cam] >= 0
    coupled = np.zeros((len(moving), points, POSE, 3))
    np.add.at(coupled, (row[system.cam[seen]], system.pt[seen]), n.W[seen, :POSE])
    of_lenses = n.H[poses:, :poses].T.reshape(len(moving), POSE, lenses)
    C = np.concatenate([of_lenses, np.swapaxes(coupled, 1, 2).reshape(-1, POSE, 3 * points)], axis=2)
    D = np.zeros((lenses + 3 * points,) * 2)
    D[:lenses, :lenses] = np.tril(n.H[poses:, poses:]) + np.tril(n.H[poses:, poses:], -1).T
    k, q = np.nonzero(system.columns[system.cam, :, 1] >= poses)
    mixed = np.zeros((lenses, points, 3))
    np.add.at(mixed, (system.columns[system.cam[k], q, 1] - poses, system.pt[k]), n.W[k, q])
    D[:lenses, lenses:] = mixed.reshape(lenses, 3 * points)
    D[lenses:, :lenses] = D[:lenses, lenses:].T
    at = lenses + 3 * np.arange(points)[:, None] + np.arange(3)
    D[at[:, :, None], at[:, None, :]] = n.Hp
    return B, C, D

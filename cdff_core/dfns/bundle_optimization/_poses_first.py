# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Levenberg-Marquardt step with the poses eliminated instead of the points, for many images of few points.

If some tens of points are observed in hundreds of images, the reduced system of the cameras is dense, since
common points couple every pose with every other one; that of the points and lenses is small (Triggs et al.
2000, §6.1).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from cdff_common.arrays import FloatArray, IntArray
from cdff_core.dfns.bundle_optimization._kernels import POSE
from cdff_core.dfns.bundle_optimization._system import NormalEquations, System


def is_cheaper(system: System) -> bool:
    """Return whether poses have far more unknowns than points and lenses, and no prior couples them."""
    pose_unknowns = POSE * int((system.pose_column >= 0).sum())
    other_unknowns = system.size - pose_unknowns + 3 * len(system.point_fixed)
    return not len(system.prior_columns) and 2 * other_unknowns <= pose_unknowns


def compute_step(
    system: System, normal: NormalEquations, damping: float
) -> tuple[FloatArray | None, FloatArray]:
    """Return the steps of cameras and lenses, and of points ``(p, 3)``; None if the system is singular."""
    adjusted, point_count = np.flatnonzero(system.pose_column >= 0), len(system.point_fixed)
    pose_unknowns = POSE * len(adjusted)
    lens_unknowns = system.size - pose_unknowns
    B, C, D = _blocks(system, normal, adjusted)
    for M in (*B, D):
        M[np.diag_indices_from(M)] += damping * np.clip(np.diagonal(M), 1e-6, 1e32)
    pose_gradient = normal.g[:pose_unknowns].reshape(-1, POSE, 1)
    other_gradient = np.concatenate([normal.g[pose_unknowns:], normal.gp.reshape(-1)])
    is_point_adjusted = (np.diff(system.start) > 0) & (system.point_fixed == 0)
    is_adjusted = np.concatenate([np.ones(lens_unknowns, bool), np.repeat(is_point_adjusted, 3)])
    try:
        B_inverse_C_and_g = np.linalg.solve(B, np.dstack([C, pose_gradient])).reshape(pose_unknowns, -1)
        B_inverse_C, B_inverse_g = B_inverse_C_and_g[:, :-1], B_inverse_C_and_g[:, -1]
        C_rows = C.reshape(pose_unknowns, -1)
        S, b = D - C_rows.T @ B_inverse_C, other_gradient - C_rows.T @ B_inverse_g
        other_step = np.zeros(len(D))
        factor = cho_factor(S[np.ix_(is_adjusted, is_adjusted)], lower=True)
        other_step[is_adjusted] = -cho_solve(factor, b[is_adjusted])
    except (LinAlgError, ValueError):
        return None, np.zeros((point_count, 3))
    step = np.concatenate([-B_inverse_g - B_inverse_C @ other_step, other_step[:lens_unknowns]])
    point_step = other_step[lens_unknowns:].reshape(point_count, 3)
    return (step if np.isfinite(step).all() else None), point_step


def _blocks(
    system: System, n: NormalEquations, adjusted: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the parts B, C, D of the normal matrix ``[[B, C], [C^T, D]]``.

    B ``(n, 6, 6)`` are the blocks of the adjusted poses, C ``(n, 6, d)`` their coupling with lenses and
    points, D ``(d, d)`` the matrix of lenses and points.
    """
    pose_unknowns, point_count = POSE * len(adjusted), len(system.point_fixed)
    lens_unknowns = system.size - pose_unknowns
    pose_columns = np.arange(pose_unknowns).reshape(-1, POSE)
    pose_blocks = n.H[pose_columns[:, :, None], pose_columns[:, None, :]]
    B = np.tril(pose_blocks) + np.swapaxes(np.tril(pose_blocks, -1), 1, 2)
    pose_row = np.full(len(system.pose_column), -1)
    pose_row[adjusted] = np.arange(len(adjusted))
    has_adjusted_camera = pose_row[system.cam] >= 0
    point_coupling = np.zeros((len(adjusted), point_count, POSE, 3))
    pose_rows, point_rows = pose_row[system.cam[has_adjusted_camera]], system.pt[has_adjusted_camera]
    np.add.at(point_coupling, (pose_rows, point_rows), n.W[has_adjusted_camera, :POSE])
    lens_coupling = n.H[pose_unknowns:, :pose_unknowns].T.reshape(len(adjusted), POSE, lens_unknowns)
    point_columns = np.swapaxes(point_coupling, 1, 2).reshape(-1, POSE, 3 * point_count)
    C = np.concatenate([lens_coupling, point_columns], axis=2)
    D = np.zeros((lens_unknowns + 3 * point_count,) * 2)
    lens_block = n.H[pose_unknowns:, pose_unknowns:]
    D[:lens_unknowns, :lens_unknowns] = np.tril(lens_block) + np.tril(lens_block, -1).T
    # Observation k and position q in its list of adjusted columns, for the columns of lenses.
    k, q = np.nonzero(system.columns[system.cam, :, 1] >= pose_unknowns)
    lens_point_coupling = np.zeros((lens_unknowns, point_count, 3))
    lens_rows = system.columns[system.cam[k], q, 1] - pose_unknowns
    np.add.at(lens_point_coupling, (lens_rows, system.pt[k]), n.W[k, q])
    D[:lens_unknowns, lens_unknowns:] = lens_point_coupling.reshape(lens_unknowns, 3 * point_count)
    D[lens_unknowns:, :lens_unknowns] = D[:lens_unknowns, lens_unknowns:].T
    rows = lens_unknowns + 3 * np.arange(point_count)[:, None] + np.arange(3)
    D[rows[:, :, None], rows[:, None, :]] = n.Hp
    return B, C, D

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Matching of two trajectories in time, and alignment of one to the other before errors are computed."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import DegenerateGeometryError, InputError
from cdff_common.geometry import se3
from cdff_dev.compare.trajectory.track import Float, Track

Mode = Literal["se3", "yaw", "sim3", "origin", "none"]


def associate(estimate: Track, reference: Track, max_difference_s: float) -> tuple[Track, Track]:
    """Return both tracks with their poses matched by time, row by row; no pose is used twice.

    Raises
    ------
    InputError
        If no two stamps are within ``max_difference_s``.
    """
    swapped = len(estimate) > len(reference)
    few, many = (reference, estimate) if swapped else (estimate, reference)
    after = np.clip(np.searchsorted(many.stamps_ns, few.stamps_ns), 1, max(len(many) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(many) - 1)
    after_is_nearer = np.abs(many.stamps_ns[after] - few.stamps_ns) < np.abs(
        few.stamps_ns - many.stamps_ns[before]
    )
    nearest = np.where(after_is_nearer, after, before)
    difference = np.abs(many.stamps_ns[nearest] - few.stamps_ns)
    selected = _unique_matches(nearest, difference) & (difference <= max_difference_s * 1e9)
    rows_few, rows_many = np.flatnonzero(selected), nearest[selected]
    if not len(rows_few):
        spans = " and ".join(
            f"{t.name} {t.stamps_ns[0] * 1e-9:.3f}..{t.stamps_ns[-1] * 1e-9:.3f} s" for t in (few, many)
        )
        raise InputError(
            f"no stamps within {max_difference_s:g} s of one another: {spans}; expected stamps of the "
            "same clock, or a larger allowed difference"
        )
    pair = few.rows(rows_few), many.rows(rows_many)
    return (pair[1], pair[0]) if swapped else pair


def _unique_matches(nearest: NDArray[np.int64], difference: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return a mask of the rows that have the smallest difference of all with the same nearest row."""
    order = np.lexsort((difference, nearest))
    is_first_of_group = np.ones(len(order), np.bool_)
    is_first_of_group[1:] = nearest[order][1:] != nearest[order][:-1]
    selected = np.zeros(len(order), np.bool_)
    selected[order[is_first_of_group]] = True
    return selected


def apply_alignment(estimate: Track, reference: Track, mode: Mode) -> tuple[Track, Float, float]:
    """Return the estimate aligned to the reference, the transform ``(4, 4)`` and the scale applied.

    Parameters
    ----------
    estimate, reference : Track
        The same number of poses, matched row by row.
    mode : str
        ``se3`` and ``sim3``: least squares on the positions, Umeyama (1991), doi:10.1109/34.88573. ``yaw``:
        translation and rotation about z, which a gravity-aligned estimator cannot observe. ``origin``: the
        first poses coincide. ``none``: no alignment.

    Raises
    ------
    DegenerateGeometryError
        If the positions do not determine the rotation.
    """
    A, scale = np.eye(4), 1.0
    if mode == "origin":
        A = reference.matrices[0] @ se3.inverse(estimate.matrices[0])
    elif mode == "yaw":
        A = _yaw(estimate.positions_m, reference.positions_m)
    elif mode != "none":
        A, scale = _umeyama(estimate.positions_m, reference.positions_m, with_scale=mode == "sim3")
    R = A[:3, :3]
    matrices = se3.transform(R @ estimate.matrices[:, :3, :3], scale * estimate.positions_m @ R.T + A[:3, 3])
    covariances = estimate.covariances
    if covariances is not None:
        J = np.zeros((6, 6))
        J[:3, :3], J[3:, 3:] = scale * R, R
        covariances = J @ covariances @ J.T
    return Track(estimate.name, estimate.stamps_ns, matrices, covariances), A, scale


def orientation_alignment(estimate: Track, reference: Track) -> Float:
    """Return the rotation ``(3, 3)`` that aligns the orientations of a track with those of a reference.

    Least squares over all poses in the chordal metric: Hartley et al. (2013), doi:10.1007/s11263-012-0601-0.
    Positions of a nearly straight path do not determine the rotation about it; the orientations do.
    """
    products = reference.matrices[:, :3, :3] @ np.swapaxes(estimate.matrices[:, :3, :3], 1, 2)
    return se3.normalise_rotation(products.mean(axis=0))


def _umeyama(source: Float, target: Float, *, with_scale: bool) -> tuple[Float, float]:
    """Return the similarity that maps source to target positions (n, 3), and its scale (Umeyama 1991)."""
    s, t = source - source.mean(axis=0), target - target.mean(axis=0)
    U, D, Vt = np.linalg.svd(t.T @ s / len(s))
    if len(s) < 3 or D[1] < 1e-12 * max(D[0], 1e-300):
        raise DegenerateGeometryError(
            f"{len(s)} positions on a line do not determine the rotation; align by yaw, origin or none",
            ["collinear"],
        )
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    R = (U * signs) @ Vt
    scale = float(np.sum(D * signs) / np.mean(np.sum(s**2, axis=1))) if with_scale else 1.0
    return se3.transform(R, target.mean(axis=0) - scale * R @ source.mean(axis=0)), scale


def _yaw(source: Float, target: Float) -> Float:
    """Return the translation and rotation about z that map source to target positions (n, 3)."""
    s, t = source - source.mean(axis=0), target - target.mean(axis=0)
    sine = float(np.sum(s[:, 0] * t[:, 1] - s[:, 1] * t[:, 0]))
    cosine = float(np.sum(s[:, :2] * t[:, :2]))
    if np.hypot(sine, cosine) < 1e-12 * max(float(np.sum(s**2)), 1e-300):
        raise DegenerateGeometryError(
            "positions without horizontal motion do not determine the heading; align by origin", ["yaw"]
        )
    R = se3.exp_so3([0.0, 0.0, np.arctan2(sine, cosine)])
    return se3.transform(R, target.mean(axis=0) - R @ source.mean(axis=0))

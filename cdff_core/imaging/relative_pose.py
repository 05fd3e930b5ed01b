# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Relative pose of two cameras from an essential matrix, and tests for points behind a camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import InputError
from cdff_core.imaging.two_view import Fit, LensErrors, fit_essential, homogeneous

#: Smallest fraction of the pairs with parallax in front of both cameras; a wrong pose has about half.
MIN_IN_FRONT = 0.75


def checked_cameras(source: ArrayLike, sink: ArrayLike | None) -> tuple[FloatArray, FloatArray]:
    """Return both camera matrices, equal if ``sink`` is None; raises InputError if one is invalid."""
    first = np.asarray(source, np.float64)
    second = first if sink is None else np.asarray(sink, np.float64)
    for K in (first, second):
        if not np.isfinite(K).all() or K[0, 0] <= 0.0 or K[1, 1] <= 0.0:
            raise InputError(f"camera matrix {K.tolist()}: expected positive focal lengths, pixels")
    return first, second


def rays(points: FloatArray, K: FloatArray) -> FloatArray:
    """Return rays ``(n, 3)``, third coordinate 1, of pixels ``(n, 2)``."""
    return homogeneous(points) @ np.linalg.inv(K).T


def angles(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the angles ``(n,)`` between vectors ``(n, 3)``, radians; small angles are exact."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b)))


def depths(
    R_sink_source: FloatArray, t_sink_source: FloatArray, source: FloatArray, sink: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return depths ``(n,)`` of closest approach along both rays, in units of the translation."""
    a, b = source @ R_sink_source.T, sink
    aa, bb, ab = (np.einsum("ij,ij->i", u, v) for u, v in ((a, a), (b, b), (a, b)))
    at, bt = a @ t_sink_source, b @ t_sink_source
    determinant = np.maximum(aa * bb - ab**2, 1e-300)
    return (ab * bt - bb * at) / determinant, (aa * bt - ab * at) / determinant


def decompose_essential(
    E: FloatArray, source: FloatArray, sink: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return R and unit t of ``x_sink = R x_source + t``, and the mask of pairs in front of both cameras.

    Of the four solutions (Hartley and Zisserman 2004, §9.6.2) the one with most pairs in front is returned.
    """
    U, _, Vt = np.linalg.svd(E)
    U, Vt = U * np.sign(np.linalg.det(U)), Vt * np.sign(np.linalg.det(Vt))
    W = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    best, most_in_front = (np.eye(3), U[:, 2], np.zeros(len(source), bool)), 0
    for quarter_rotation in (W, W.T):
        R = U @ quarter_rotation @ Vt
        for t in (U[:, 2], -U[:, 2]):
            depth_source, depth_sink = depths(R, t, source, sink)
            is_in_front = (depth_source > 0.0) & (depth_sink > 0.0)
            if is_in_front.sum() > most_in_front:
                best, most_in_front = (R, t, is_in_front), int(is_in_front.sum())
    return best


def fit_in_front(
    R: FloatArray,
    t: FloatArray,
    K: tuple[FloatArray, FloatArray],
    source: FloatArray,
    sink: FloatArray,
    gate_sigmas: float,
    floor_px: float,
    lenses: LensErrors | None = None,
) -> tuple[Fit, FloatArray, FloatArray]:
    """Refine with ``fit_essential`` over the pairs whose rays do not intersect behind a camera.

    Half of the outliers do. The sign of the depth is unknown for rays that are parallel within three standard
    deviations: these pairs are used.
    """
    fit, R, t = fit_essential(R, t, K, source, sink, gate_sigmas, floor_px, lenses)
    a, b = rays(source, K[0]), rays(sink, K[1])
    depth_source, depth_sink = depths(R, t, a, b)
    sigma_rad = fit.sigma_px * np.sqrt(1.0 / (K[0][0, 0] * K[0][1, 1]) + 1.0 / (K[1][0, 0] * K[1][1, 1]))
    behind = ((depth_source < 0.0) | (depth_sink < 0.0)) & (angles(a @ R.T, b) > 3.0 * sigma_rad)
    in_front = ~behind
    if not (behind & fit.inliers).any() or in_front.sum() < 5:
        return fit, R, t
    refit, R, t = fit_essential(R, t, K, source[in_front], sink[in_front], gate_sigmas, floor_px, lenses)
    inliers, residuals = fit.inliers & in_front, fit.residuals.copy()
    inliers[in_front], residuals[in_front] = refit.inliers, refit.residuals
    return replace(refit, inliers=inliers, residuals=residuals), R, t

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search for the relative pose among the local minima of the epipolar error.

With a small baseline, or where one plane dominates, the epipolar error has several minima: a wrong one
explains the translation by a rotation, and places many points behind a camera. The search refines several
starts and compares their errors and the ratios of points in front of both cameras.

References
----------
.. [1] R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., 2004, doi:10.1017/CBO9780511811685, §9.6
.. [2] J. Oliensis, A critique of structure-from-motion algorithms, CVIU 80(2), 2000,
   doi:10.1006/cviu.2000.0869
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_core.imaging.relative_pose import angles, decompose_essential, rays
from cdff_core.imaging.sampson import sampson
from cdff_core.imaging.two_view import fit_essential

#: Pairs that the search uses, evenly distributed over all.
_SEARCHED_PAIRS = 200
#: Parallax of a pair whose depth has a sign, in standard deviations.
_MIN_PARALLAX_SIGMAS = 3.0
#: Angle between two directions of translation below which their minima are the same.
_SAME_DEG = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class RelativePose:
    """A local minimum of the epipolar error.

    Attributes
    ----------
    R, t : ndarray, shapes (3, 3) and (3,)
        ``x_sink = R x_source + t``, t of length 1.
    cost : float
        Mean squared Sampson distance, each limited to the gate, pixels².
    in_front : float
        Ratio of the pairs with parallax whose rays intersect in front of both cameras; 1 without such
        pairs.
    """

    R: FloatArray
    t: FloatArray
    cost: float
    in_front: float


def best_rotation(source_rays: FloatArray, sink_rays: FloatArray) -> FloatArray:
    """Return R ``(3, 3)`` that best maps the directions of the rays ``(n, 3)`` (Kabsch 1976)."""
    unit_rays = [
        vectors / np.linalg.norm(vectors, axis=1, keepdims=True) for vectors in (source_rays, sink_rays)
    ]
    U, _, Vt = np.linalg.svd(unit_rays[1].T @ unit_rays[0])
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)


def find_minima(
    E: FloatArray,
    K: tuple[FloatArray, FloatArray],
    source: FloatArray,
    sink: FloatArray,
    gate_sigmas: float,
    floor_px: float,
) -> list[RelativePose]:
    """Return the distinct minima, the most plausible first.

    The starts are the decomposition of E, and the best pure rotation with each of three translations: the
    eigenvectors of the epipolar error, which is quadratic in the translation ([2]_).
    """
    step = max(len(source) // _SEARCHED_PAIRS, 1)
    source, sink = source[::step], sink[::step]
    source_rays, sink_rays = rays(source, K[0]), rays(sink, K[1])
    R, t, _ = decompose_essential(E, source_rays, sink_rays)
    rotation = best_rotation(source_rays, sink_rays)
    normals = np.cross(source_rays @ rotation.T, sink_rays)
    starts = [(R, t), *((rotation, v) for v in np.linalg.eigh(normals.T @ normals)[1].T)]
    minima: list[RelativePose] = []
    for R, t in starts:
        fit, R, t = fit_essential(R, t, K, source, sink, gate_sigmas, floor_px)
        minimum = _with_points_in_front(R, t, K, (source, sink), fit.sigma_px, gate_sigmas * floor_px)
        if not any(_is_same(minimum, other) for other in minima):
            minima.append(minimum)
    return sorted(minima, key=lambda m: m.cost / max(m.in_front, 1e-3))


def _with_points_in_front(
    R: FloatArray,
    t: FloatArray,
    K: tuple[FloatArray, FloatArray],
    pairs: tuple[FloatArray, FloatArray],
    sigma_px: float,
    gate_px: float,
) -> RelativePose:
    """Return the minimum with the decomposition of its E that places most pairs in front of both cameras."""
    source_rays, sink_rays = rays(pairs[0], K[0]), rays(pairs[1], K[1])
    R, t, is_in_front = decompose_essential(se3.skew(t) @ R, source_rays, sink_rays)
    F = np.linalg.inv(K[1]).T @ se3.skew(t) @ R @ np.linalg.inv(K[0])
    cost = float(np.mean(np.minimum(np.abs(sampson(F, *pairs)), gate_px) ** 2))
    sigma_rad = sigma_px * np.sqrt(sum(1.0 / (k[0, 0] * k[1, 1]) for k in K))
    has_parallax = angles(source_rays @ R.T, sink_rays) > _MIN_PARALLAX_SIGMAS * sigma_rad
    return RelativePose(R, t, cost, float(is_in_front[has_parallax].mean()) if has_parallax.any() else 1.0)


def _is_same(a: RelativePose, b: RelativePose) -> bool:
    return float(np.degrees(angles(a.t[None], b.t[None])[0])) < _SAME_DEG


def ambiguity(minima: list[RelativePose], min_in_front: float) -> float:
    """Return the cost of the best minimum divided by that of the next one with enough points in front.

    0 without such a minimum, 1 if both explain the pairs equally well.
    """
    others = [m.cost for m in minima[1:] if m.in_front >= min_in_front]
    return min(minima[0].cost / max(min(others), 1e-300), 1.0) if others else 0.0

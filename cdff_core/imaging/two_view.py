# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two-view models: residuals, refinement, covariance and significance.

Points are pixels ``(n, 2)`` of the first image (source) and the second image (sink). The fundamental matrix
satisfies ``sink' F source = 0`` for homogeneous points.

References
----------
.. [1] R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., 2004, doi:10.1017/CBO9780511811685, §4.2,
   §5.2, §11.4
.. [2] A. Bartoli, P. Sturm, Nonlinear Estimation of the Fundamental Matrix with Minimal Parameters, PAMI
   26(3), 2004, doi:10.1109/TPAMI.2004.1262342
.. [3] L. Moisan, B. Stival, A Probabilistic Criterion to Detect Rigid Point Matches Between Two Images, IJCV
   57(3), 2004, doi:10.1023/B:VISI.0000013094.38752.54
.. [4] R. D. Cook, Detection of Influential Observation in Linear Regression, Technometrics 19(1), 1977,
   doi:10.1080/00401706.1977.10489493
.. [5] J. G. MacKinnon, H. White, Some heteroskedasticity-consistent covariance matrix estimators with
   improved finite sample properties, Journal of Econometrics 29(3), 1985, doi:10.1016/0304-4076(85)90158-7
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.geometry import se3

Function = Callable[[FloatArray], FloatArray]
#: Ratio of the standard deviation of a Gaussian to its median absolute deviation.
_MAD = 1.4826
#: Maximum number of Gauss-Newton steps.
_STEPS = 20
#: Relative excess of squared errors over the sandwich covariance due to outliers within the gate, times the
#: number of inliers; calibrated on simulated views of 60 to 900 pairs with 30 % outliers.
_WRONG_PAIRS = 25.0


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A model fitted to pairs.

    Attributes
    ----------
    matrix : ndarray, shape (3, 3)
    covariance : ndarray, shape (9, 9)
        Covariance of the row-major matrix entries; its rank is the model's number of parameters.
    inliers : ndarray of bool, shape (n,)
    residuals : ndarray, shape (n,)
        Distance of each pair from the model, pixels.
    sigma_px : float
        Standard deviation of one residual of an inlier.
    parameters : ndarray, shape (d, d)
        Covariance of the parameters of the model.
    """

    matrix: FloatArray
    covariance: FloatArray
    inliers: BoolArray
    residuals: FloatArray
    sigma_px: float
    parameters: FloatArray


def homogeneous(points: FloatArray) -> FloatArray:
    """Return homogeneous points ``(n, 3)`` of points ``(n, 2)``."""
    return np.column_stack([points, np.ones(len(points))])


def sampson(F: FloatArray, source: FloatArray, sink: FloatArray) -> FloatArray:
    """Return signed Sampson distances ``(n,)``, pixels: first-order distances from the geometry ([1]_)."""
    x, y = homogeneous(source), homogeneous(sink)
    Fx, Fy = x @ F.T, y @ F
    norm = np.sqrt(Fx[:, 0] ** 2 + Fx[:, 1] ** 2 + Fy[:, 0] ** 2 + Fy[:, 1] ** 2)
    return np.asarray(np.einsum("ij,ij->i", y, Fx) / np.maximum(norm, 1e-300))


def transfer(H: FloatArray, points: FloatArray) -> FloatArray:
    """Return points ``(n, 2)`` mapped by a homography; NaN at its horizon."""
    mapped = homogeneous(points) @ H.T
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(mapped[:, :2] / mapped[:, 2:])


def homography_residuals(H: FloatArray, source: FloatArray, sink: FloatArray) -> FloatArray:
    """Return transfer errors ``(n, 2)`` in the sink, scaled as if distributed over both images."""
    with np.errstate(invalid="ignore"):
        error = (transfer(H, source) - sink) / np.sqrt(2.0)
    return np.where(np.isfinite(error), error, 1e6)


def fit_fundamental(
    F: FloatArray, source: FloatArray, sink: FloatArray, gate_sigmas: float, floor_px: float
) -> Fit:
    """Refine a fundamental matrix ([2]_): ``F = U diag(cos a, sin a, 0) V'``, of unit norm."""
    first, second = _conditioning(source), _conditioning(sink)
    U, s, Vt = np.linalg.svd(np.linalg.inv(second).T @ F @ np.linalg.inv(first))
    state = [U * np.sign(np.linalg.det(U)), float(np.arctan2(s[1], s[0])), Vt.T * np.sign(np.linalg.det(Vt))]

    def matrix_at(d: FloatArray) -> FloatArray:
        R, V = state[0] @ se3.exp_so3(d[:3]), state[2] @ se3.exp_so3(d[3:6])
        angle = state[1] + d[6]
        M = second.T @ R @ np.diag([np.cos(angle), np.sin(angle), 0.0]) @ V.T @ first
        return np.asarray(M / np.linalg.norm(M))

    def accept(d: FloatArray) -> None:
        state[0], state[2] = state[0] @ se3.exp_so3(d[:3]), state[2] @ se3.exp_so3(d[3:6])
        state[1] += float(d[6])

    return _fit(matrix_at, accept, lambda M: sampson(M, source, sink)[:, None], 7, gate_sigmas, floor_px)


def fit_essential(
    R: FloatArray,
    t: FloatArray,
    K: tuple[FloatArray, FloatArray],
    source: FloatArray,
    sink: FloatArray,
    gate_sigmas: float,
    floor_px: float,
) -> tuple[Fit, FloatArray, FloatArray]:
    """Refine the relative pose; return the fit, R and unit t of ``x_sink = R x_source + t``.

    The matrix of the fit is E, its residuals are pixels. The five ``parameters`` are three of the rotation
    (perturbation on the left) and two of t along the columns of ``tangents(t)``.
    """
    state = [np.array(R), np.array(t) / np.linalg.norm(t)]
    inverse = np.linalg.inv(K[0]), np.linalg.inv(K[1])

    def pose(d: FloatArray) -> tuple[FloatArray, FloatArray]:
        direction = state[1] + tangents(state[1]) @ d[3:5]
        return se3.exp_so3(d[:3]) @ state[0], direction / np.linalg.norm(direction)

    def matrix_at(d: FloatArray) -> FloatArray:
        rotation, direction = pose(d)
        return np.asarray(se3.skew(direction) @ rotation)

    def accept(d: FloatArray) -> None:
        state[0], state[1] = pose(d)

    def residuals(E: FloatArray) -> FloatArray:
        return sampson(inverse[1].T @ E @ inverse[0], source, sink)[:, None]

    fit = _fit(matrix_at, accept, residuals, 5, gate_sigmas, floor_px)
    return fit, se3.normalise_rotation(state[0]), state[1]


def fit_homography(
    H: FloatArray, source: FloatArray, sink: FloatArray, gate_sigmas: float, floor_px: float
) -> Fit:
    """Refine a homography of unit norm along the eight directions that change it."""
    first, second = _conditioning(source), _conditioning(sink)
    state = [second @ H @ np.linalg.inv(first)]
    state[0] /= np.linalg.norm(state[0])

    def perturbed(d: FloatArray) -> FloatArray:
        basis = np.linalg.svd(state[0].reshape(1, 9))[2][1:].T
        return np.asarray(state[0] + (basis @ d).reshape(3, 3))

    def matrix_at(d: FloatArray) -> FloatArray:
        M = np.linalg.inv(second) @ perturbed(d) @ first
        return np.asarray(M / np.linalg.norm(M))

    def accept(d: FloatArray) -> None:
        state[0] = perturbed(d) / np.linalg.norm(perturbed(d))

    return _fit(matrix_at, accept, lambda M: homography_residuals(M, source, sink), 8, gate_sigmas, floor_px)


def _conditioning(points: FloatArray) -> FloatArray:
    """Return the matrix (3, 3) that centres points and scales them to unit distance ([1]_ §4.4.4)."""
    centre = points.mean(axis=0)
    scale = 1.0 / max(float(np.sqrt(np.mean((points - centre) ** 2))), 1e-9)
    return np.array([[scale, 0.0, -scale * centre[0]], [0.0, scale, -scale * centre[1]], [0.0, 0.0, 1.0]])


def tangents(direction: FloatArray) -> FloatArray:
    """Return two orthonormal columns ``(3, 2)`` perpendicular to a unit vector."""
    return np.asarray(np.linalg.svd(direction[None])[2][1:].T)


def _fit(
    matrix_at: Function,
    accept: Callable[[FloatArray], None],
    residuals: Function,
    dimension: int,
    gate: float,
    floor_px: float,
) -> Fit:
    """Minimise by Gauss-Newton; each step selects the inliers by ``gate`` standard deviations.

    A pair is tested by its distance from the model of the other inliers, since an outlier with large leverage
    attracts the model, so that its own residual is small ([4]_). ``matrix_at`` returns the matrix after a
    small change ``(d,)`` of the parameters, ``accept`` applies this change, and ``residuals`` returns those
    ``(n, k)`` of a matrix.
    """
    zero, steps = np.zeros(dimension), 1e-6 * np.eye(dimension)

    def derivative(of: Function) -> FloatArray:
        return np.stack([(of(d) - of(-d)) / 2e-6 for d in steps], axis=-1)

    def distances(d: FloatArray) -> FloatArray:
        return residuals(matrix_at(d))

    inliers, sigma, leverage = np.zeros(0, bool), floor_px, np.zeros(0)
    for iteration in range(_STEPS):
        r = distances(zero)
        size = _size(r)
        core = size < 4.0 * sigma if iteration else size < np.inf
        near = size[core][size[core] < 8.0 * floor_px]
        sigma = float(np.clip(_MAD * np.median(near) if len(near) else floor_px, 0.25 * floor_px, floor_px))
        leverage = leverage if iteration else np.zeros(len(size))
        inliers = size / (1.0 - leverage) < gate * sigma
        if inliers.sum() * r.shape[1] <= dimension:
            break
        J = derivative(distances)
        A = J[inliers].reshape(-1, dimension)
        leverage = np.where(inliers, _leverage(J, A), 0.0)
        normal = A.T @ A
        step = np.asarray(-np.linalg.lstsq(normal, A.T @ r[inliers].reshape(-1), rcond=1e-14)[0], np.float64)
        accept(step)
        if float(step @ normal @ step) < 1e-8 * sigma**2:
            break
    r = distances(zero)
    inliers = _size(r) / (1.0 - leverage) < gate * sigma
    return _with_covariance(matrix_at(zero), derivative(matrix_at), derivative(distances), r, inliers, sigma)


def _size(r: FloatArray) -> FloatArray:
    """Return the distance ``(n,)`` per component of residuals ``(n, k)``."""
    return np.asarray(np.linalg.norm(r, axis=1) / np.sqrt(r.shape[1]))


def _leverage(J: FloatArray, A: FloatArray) -> FloatArray:
    """Return the leverage ``(n,)`` of each pair; ``A`` (m, d) are the derivatives of the inliers."""
    inverse = np.linalg.pinv(A.T @ A, rcond=1e-15, hermitian=True)
    return np.asarray(np.minimum(np.einsum("nki,ij,nkj->n", J, inverse, J) / J.shape[1], 0.99))


def _with_covariance(
    matrix: FloatArray,
    slope: FloatArray,
    J: FloatArray,
    r: FloatArray,
    inliers: BoolArray,
    sigma: float,
) -> Fit:
    """Return the fit with its covariance from leave-one-out residuals.

    It is ``(J'J)^-1 sum(s s') (J'J)^-1`` with ``s = J' r / (1 - h)`` of each pair and its leverage h ([5]_),
    which is consistent for pairs of different noise. It is enlarged for outliers within the gate of a line,
    and propagated to the nine matrix entries; ``slope`` (3, 3, d) are the derivatives of the matrix.
    """
    dimension = J.shape[-1]
    size = _size(r)
    freedom = inliers.sum() * r.shape[1] - dimension
    if freedom <= 0:
        unknown = np.full((dimension, dimension), np.inf)
        return Fit(matrix, np.full((9, 9), np.inf), inliers, size, sigma, unknown)
    variance = float((r[inliers] ** 2).sum()) / freedom
    A = J[inliers].reshape(-1, dimension)
    inverse = np.linalg.pinv(A.T @ A, rcond=1e-15, hermitian=True)
    scores = np.einsum("nki,nk->ni", J, r)[inliers] / (1.0 - _leverage(J[inliers], A))[:, None]
    # Many outliers are within the gate of a line, few within that of a point.
    excess = _WRONG_PAIRS / inliers.sum() if r.shape[1] == 1 else 0.0
    parameters = (1.0 + excess) * inverse @ (scores.T @ scores) @ inverse
    D = slope.reshape(9, dimension)
    return Fit(matrix, D @ parameters @ D.T, inliers, size, float(np.sqrt(variance)), parameters)


def log10_false_alarms(pairs: int, inliers: int, chance: float, minimal: int) -> float:
    """Return the log10 of the expected number of models with so many inliers among random pairs ([3]_).

    ``chance`` is the probability that a random pair is within the inliers' distance, ``minimal`` the number
    of pairs of a minimal sample. Below 0 the inliers are significant.
    """
    if inliers <= minimal:
        return float("inf")

    def log10_choose(n: int, k: int) -> float:
        return float((gammaln(n + 1) - gammaln(k + 1) - gammaln(n - k + 1)) / np.log(10.0))

    tests = np.log10(max(pairs - minimal, 1)) + log10_choose(pairs, inliers) + log10_choose(inliers, minimal)
    return float(tests + (inliers - minimal) * np.log10(min(max(chance, 1e-12), 1.0)))


def inlier_probabilities(
    residuals: FloatArray, sigma_px: float, inlier_fraction: float, span_px: float
) -> FloatArray:
    """Return inlier probabilities: Gaussian residuals against residuals uniform over ``span_px``."""
    sigma = max(sigma_px, 1e-6)
    inlier = inlier_fraction * np.exp(-0.5 * (residuals / sigma) ** 2) / (sigma * np.sqrt(2.0 * np.pi))
    outlier = (1.0 - inlier_fraction) / span_px
    return np.asarray(inlier / (inlier + outlier + 1e-300))

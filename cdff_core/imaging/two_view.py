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
.. [6] K.-Y. Liang, S. L. Zeger, Longitudinal data analysis using generalized linear models, Biometrika 73(1),
   1986, doi:10.1093/biomet/73.1.13
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.geometry import se3
from cdff_core.imaging.sampson import sampson, sampson_derivative

Function = Callable[[FloatArray], FloatArray]
#: Ratio of the standard deviation of a Gaussian to its median absolute deviation.
_MAD = 1.4826
#: Maximum number of Gauss-Newton steps.
_STEPS = 20
#: Generators of the rotations about x, y and z, (3, 3, 3).
_GENERATORS = se3.skew(np.eye(3))
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


@dataclass(frozen=True, slots=True)
class LensErrors:
    """Standard deviations of the errors of a camera model.

    Attributes
    ----------
    axis_rad : float
        Of the direction of the optical axis, which moves the principal point and tilts the image plane.
        A calibration hardly separates both from a rotation of the camera: they exceed its residuals.
    edge_px : float
        Of the displacement at the edge by each of focal lengths, skew and radial distortion, pixels.
    """

    axis_rad: float
    edge_px: float

    def displacements(self, points: FloatArray, K: FloatArray) -> FloatArray:
        """Return the displacements ``(n, 2, 8)`` of pixels by errors of one sigma of eight parameters.

        Principal point (2), tilt (2), focal lengths (2), skew (1), radial distortion (1).
        """
        offset = points - K[:2, 2]
        x, y = (offset / np.array([K[0, 0], K[1, 1]])).T
        u, v = (offset / max(float(np.linalg.norm(offset, axis=1).max()), 1e-9)).T
        r2, zero, one = u**2 + v**2, np.zeros(len(u)), np.ones(len(u))
        of_axis = self.axis_rad * np.array(
            [
                [K[0, 0] * one, zero, K[0, 0] * x**2, K[0, 0] * x * y],
                [zero, K[1, 1] * one, K[1, 1] * x * y, K[1, 1] * y**2],
            ]
        )
        of_edge = self.edge_px * np.array([[u, zero, 0.5 * v, u * r2], [zero, v, 0.5 * u, v * r2]])
        return np.concatenate([of_axis, of_edge], axis=1).transpose(2, 0, 1)


def homogeneous(points: FloatArray) -> FloatArray:
    """Return homogeneous points ``(n, 3)`` of points ``(n, 2)``."""
    return np.column_stack([points, np.ones(len(points))])


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


def _homography_derivative(H: FloatArray, source: FloatArray) -> FloatArray:
    """Return the derivative ``(n, 2, 9)`` of ``homography_residuals`` with respect to the row-major entries
    of H.
    """
    x = homogeneous(source)
    transformed = x @ H.T
    J = np.zeros((len(x), 2, 9))
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = x / (np.sqrt(2.0) * transformed[:, 2:])
        J[:, 0, 0:3], J[:, 1, 3:6] = scaled, scaled
        J[:, :, 6:9] = -(transformed[:, :2] / transformed[:, 2:])[:, :, None] * scaled[:, None, :]
    return np.where(np.isfinite(J), J, 0.0)


def fit_fundamental(
    F: FloatArray, source: FloatArray, sink: FloatArray, gate_sigmas: float, floor_px: float
) -> Fit:
    """Refine a fundamental matrix ([2]_): ``F = U diag(cos a, sin a, 0) V'``, of unit norm."""
    first, second = _conditioning(source), _conditioning(sink)
    U, s, Vt = np.linalg.svd(np.linalg.inv(second).T @ F @ np.linalg.inv(first))
    state = [U * np.sign(np.linalg.det(U)), float(np.arctan2(s[1], s[0])), Vt.T * np.sign(np.linalg.det(Vt))]

    def matrix() -> FloatArray:
        D = np.diag([np.cos(state[1]), np.sin(state[1]), 0.0])
        M = second.T @ state[0] @ D @ state[2].T @ first
        return np.asarray(M / np.linalg.norm(M))

    def accept(d: FloatArray) -> None:
        state[0], state[2] = state[0] @ se3.exp_so3(d[:3]), state[2] @ se3.exp_so3(d[3:6])
        state[1] += float(d[6])

    def matrix_derivative() -> FloatArray:
        D = np.diag([np.cos(state[1]), np.sin(state[1]), 0.0])
        by_angle = np.diag([-np.sin(state[1]), np.cos(state[1]), 0.0])
        derivatives = np.concatenate([_GENERATORS @ D, D @ _GENERATORS.transpose(0, 2, 1), by_angle[None]])
        left, right = second.T @ state[0], state[2].T @ first
        return _derivative_of_unit_matrix(left @ D @ right, left @ derivatives @ right)

    model = _Model(
        matrix=matrix,
        accept=accept,
        residuals=lambda M: sampson(M, source, sink)[:, None],
        jacobian=lambda M: _chain(sampson_derivative(M, source, sink), matrix_derivative()),
        matrix_derivative=matrix_derivative,
        dimension=7,
        cells=image_cells(source),
    )
    return _fit(model, gate_sigmas, floor_px)


def fit_essential(
    R: FloatArray,
    t: FloatArray,
    K: tuple[FloatArray, FloatArray],
    source: FloatArray,
    sink: FloatArray,
    gate_sigmas: float,
    floor_px: float,
    lenses: LensErrors | None = None,
) -> tuple[Fit, FloatArray, FloatArray]:
    """Refine the relative pose; return the fit, R and unit t of ``x_sink = R x_source + t``.

    The matrix of the fit is E, its residuals are pixels. The five ``parameters`` are three of the rotation
    (perturbation on the left) and two of t along the columns of ``tangents(t)``. The covariance contains the
    errors ``lenses`` of the camera models, independent in both cameras.
    """
    state = [np.array(R), np.array(t) / np.linalg.norm(t)]
    bases = [tangents(state[1])]
    inverse = np.linalg.inv(K[0]), np.linalg.inv(K[1])
    F_by_E = np.kron(inverse[1].T, inverse[0].T)

    def matrix() -> FloatArray:
        return np.asarray(se3.skew(state[1]) @ state[0])

    def accept(d: FloatArray) -> None:
        direction = state[1] + bases[0] @ d[3:5]
        state[0], state[1] = se3.exp_so3(d[:3]) @ state[0], direction / np.linalg.norm(direction)
        bases[0] = tangents(state[1])

    def residuals(E: FloatArray) -> FloatArray:
        return sampson(inverse[1].T @ E @ inverse[0], source, sink)[:, None]

    def jacobian(E: FloatArray) -> FloatArray:
        by_F = sampson_derivative(inverse[1].T @ E @ inverse[0], source, sink)
        return _chain(by_F, F_by_E @ matrix_derivative())

    def matrix_derivative() -> FloatArray:
        by_rotation = se3.skew(state[1]) @ _GENERATORS @ state[0]
        by_direction = se3.skew(bases[0].T) @ state[0]
        return np.concatenate([by_rotation, by_direction]).reshape(5, 9).T

    model = _Model(
        matrix=matrix,
        accept=accept,
        residuals=residuals,
        jacobian=jacobian,
        matrix_derivative=matrix_derivative,
        dimension=5,
        cells=image_cells(source),
    )
    fit = _fit(model, gate_sigmas, floor_px)
    if lenses is not None and np.isfinite(fit.parameters).all():
        D, inliers = matrix_derivative(), fit.inliers
        J = jacobian(fit.matrix)[inliers, 0]
        F = inverse[1].T @ fit.matrix @ inverse[0]
        by_lenses = _sampson_by_lenses(F, K, source[inliers], sink[inliers], lenses)
        parameters_by_lenses = _inverse(J.T @ J) @ (J.T @ by_lenses)
        parameters = fit.parameters + parameters_by_lenses @ parameters_by_lenses.T
        fit = replace(fit, covariance=D @ parameters @ D.T, parameters=parameters)
    return fit, se3.normalise_rotation(state[0]), state[1]


def _sampson_by_lenses(
    F: FloatArray,
    K: tuple[FloatArray, FloatArray],
    source: FloatArray,
    sink: FloatArray,
    lenses: LensErrors,
) -> FloatArray:
    """Return the changes ``(n, 16)`` of the Sampson distances by errors of one sigma of each parameter."""
    x, y = homogeneous(source), homogeneous(sink)
    Fx, Fy = x @ F.T, y @ F
    norm = np.sqrt((Fx[:, :2] ** 2).sum(axis=1) + (Fy[:, :2] ** 2).sum(axis=1))[:, None]
    by_source = np.einsum("ni,nij->nj", Fy[:, :2] / norm, lenses.displacements(source, K[0]))
    by_sink = np.einsum("ni,nij->nj", Fx[:, :2] / norm, lenses.displacements(sink, K[1]))
    return np.hstack([by_source, by_sink])


def fit_homography(
    H: FloatArray, source: FloatArray, sink: FloatArray, gate_sigmas: float, floor_px: float
) -> Fit:
    """Refine a homography of unit norm along the eight directions that change it."""
    first, second = _conditioning(source), _conditioning(sink)
    inverse = np.linalg.inv(second)
    conditioned = second @ H @ np.linalg.inv(first)
    state = [conditioned / np.linalg.norm(conditioned)]
    bases = [tangents(state[0].reshape(9))]

    def matrix() -> FloatArray:
        M = inverse @ state[0] @ first
        return np.asarray(M / np.linalg.norm(M))

    def accept(d: FloatArray) -> None:
        changed = state[0] + (bases[0] @ d).reshape(3, 3)
        state[0] = changed / np.linalg.norm(changed)
        bases[0] = tangents(state[0].reshape(9))

    def matrix_derivative() -> FloatArray:
        derivatives = bases[0].T.reshape(-1, 3, 3)
        return _derivative_of_unit_matrix(inverse @ state[0] @ first, inverse @ derivatives @ first)

    model = _Model(
        matrix=matrix,
        accept=accept,
        residuals=lambda M: homography_residuals(M, source, sink),
        jacobian=lambda M: _chain(_homography_derivative(M, source), matrix_derivative()),
        matrix_derivative=matrix_derivative,
        dimension=8,
        cells=image_cells(source),
    )
    return _fit(model, gate_sigmas, floor_px)


def _conditioning(points: FloatArray) -> FloatArray:
    """Return the matrix (3, 3) that centres points and scales them to unit distance ([1]_ §4.4.4)."""
    centre = points.mean(axis=0)
    scale = 1.0 / max(float(np.sqrt(np.mean((points - centre) ** 2))), 1e-9)
    return np.array([[scale, 0.0, -scale * centre[0]], [0.0, scale, -scale * centre[1]], [0.0, 0.0, 1.0]])


def image_cells(points: FloatArray) -> IntArray:
    """Return the cell ``(n,)`` of each pixel, of 8 x 8 that cover all of them."""
    low, size = points.min(axis=0), np.maximum(np.ptp(points, axis=0), 1e-9)
    column, row = np.minimum((8.0 * (points - low) / size).astype(np.int64), 7).T
    return np.asarray(8 * row + column)


def tangents(direction: FloatArray) -> FloatArray:
    """Return orthonormal columns ``(n, n - 1)`` perpendicular to a unit vector ``(n,)``."""
    return np.asarray(np.linalg.svd(direction[None])[2][1:].T)


@dataclass(frozen=True, slots=True)
class _Model:
    """A matrix with d parameters, and the residuals of the n pairs.

    Attributes
    ----------
    matrix : callable
        Returns the matrix.
    accept : callable
        Applies a change ``(d,)`` of the parameters.
    residuals : callable
        Returns the residuals ``(n, k)`` of a matrix.
    jacobian : callable
        Returns the derivative ``(n, k, d)`` of the residuals with respect to the parameters, given the
        matrix at them.
    matrix_derivative : callable
        Returns the derivative ``(9, d)`` of the matrix with respect to the parameters.
    dimension : int
        Number of parameters d.
    cells : ndarray of int, shape (n,)
        Cell of the first image that contains the point of each pair.
    """

    matrix: Callable[[], FloatArray]
    accept: Callable[[FloatArray], None]
    residuals: Function
    jacobian: Function
    matrix_derivative: Callable[[], FloatArray]
    dimension: int
    cells: IntArray


def _chain(by_matrix: FloatArray, D: FloatArray) -> FloatArray:
    """Return ``by_matrix @ D`` (n, k, d) of derivatives (n, k, 9) and (9, d), as one product."""
    n, k, _ = by_matrix.shape
    return np.asarray((by_matrix.reshape(n * k, 9) @ D).reshape(n, k, -1))


def _derivative_of_unit_matrix(M: FloatArray, derivatives: FloatArray) -> FloatArray:
    """Return the derivative ``(9, d)`` of ``M / |M|``, given the derivatives ``(d, 3, 3)`` of M."""
    unit, rows = M.reshape(9) / np.linalg.norm(M), derivatives.reshape(-1, 9) / np.linalg.norm(M)
    return np.asarray((rows - np.outer(rows @ unit, unit)).T)


def _fit(model: _Model, gate: float, floor_px: float) -> Fit:
    """Minimise by Gauss-Newton; each step selects the inliers by ``gate`` standard deviations.

    A pair is tested by its distance from the model of the other inliers, since an outlier with large leverage
    attracts the model, so that its own residual is small ([4]_).
    """
    dimension = model.dimension
    inliers, sigma, leverage = np.zeros(0, bool), floor_px, np.zeros(0)
    for iteration in range(_STEPS):
        matrix = model.matrix()
        r = model.residuals(matrix)
        size = _size(r)
        core = size < 4.0 * sigma if iteration else size < np.inf
        small_residuals = size[core][size[core] < 8.0 * floor_px]
        sigma = float(
            np.clip(
                _MAD * np.median(small_residuals) if len(small_residuals) else floor_px,
                0.25 * floor_px,
                floor_px,
            )
        )
        leverage = leverage if iteration else np.zeros(len(size))
        inliers = size / (1.0 - leverage) < gate * sigma
        if inliers.sum() * r.shape[1] <= dimension:
            break
        J = model.jacobian(matrix)
        A = J[inliers].reshape(-1, dimension)
        normal = A.T @ A
        inverse = _inverse(normal)
        leverage = np.where(inliers, _leverage(J, inverse), 0.0)
        step = -inverse @ (A.T @ r[inliers].reshape(-1))
        model.accept(step)
        if float(step @ normal @ step) < 1e-6 * sigma**2:
            break
    matrix = model.matrix()
    r, D = model.residuals(matrix), model.matrix_derivative()
    inliers = _size(r) / (1.0 - leverage) < gate * sigma
    return _with_covariance(matrix, D, model.jacobian(matrix), r, inliers, sigma, model.cells)


def _size(r: FloatArray) -> FloatArray:
    """Return the distance ``(n,)`` per component of residuals ``(n, k)``."""
    return np.asarray(np.linalg.norm(r, axis=1) / np.sqrt(r.shape[1]))


def _inverse(normal: FloatArray) -> FloatArray:
    """Return the inverse (d, d) of normal equations, without the directions that are not determined."""
    values, vectors = np.linalg.eigh(normal)
    is_determined = values > 1e-15 * values[-1]
    vectors = vectors[:, is_determined]
    return np.asarray(vectors / values[is_determined] @ vectors.T)


def _leverage(J: FloatArray, inverse: FloatArray) -> FloatArray:
    """Return the leverage ``(n,)`` of each pair, given the ``inverse`` (d, d) of the normal equations."""
    rows = J.reshape(-1, J.shape[2])
    of_rows = np.einsum("ni,ni->n", rows @ inverse, rows).reshape(J.shape[:2])
    return np.asarray(np.minimum(of_rows.mean(axis=1), 0.99))


def _with_covariance(
    matrix: FloatArray,
    D: FloatArray,
    J: FloatArray,
    r: FloatArray,
    inliers: BoolArray,
    sigma: float,
    cells: IntArray,
) -> Fit:
    """Return the fit with its covariance from leave-one-out residuals.

    It is ``(J'J)^-1 sum(s s') (J'J)^-1`` with ``s = J' r / (1 - h)`` of each pair and its leverage h ([5]_),
    which is consistent for pairs of different noise, and for errors that are equal within a cell of the image
    (``cells`` ``(n,)``). It is enlarged for outliers within the gate of a line, and propagated to the nine
    matrix entries; ``D`` (9, d) is the derivative of the matrix with respect to the parameters.
    """
    dimension = J.shape[-1]
    size = _size(r)
    freedom = inliers.sum() * r.shape[1] - dimension
    if freedom <= 0:
        unknown = np.full((dimension, dimension), np.inf)
        return Fit(matrix, np.full((9, 9), np.inf), inliers, size, sigma, unknown)
    variance = float((r[inliers] ** 2).sum()) / freedom
    A = J[inliers].reshape(-1, dimension)
    inverse = _inverse(A.T @ A)
    scores = np.einsum("nki,nk->ni", J, r)[inliers] / (1.0 - _leverage(J[inliers], inverse))[:, None]
    # Many outliers are within the gate of a line, few within that of a point.
    excess = _WRONG_PAIRS / inliers.sum() if r.shape[1] == 1 else 0.0
    score_products = _with_correlation(scores, cells[inliers])
    parameters = (1.0 + excess) * inverse @ score_products @ inverse
    return Fit(matrix, D @ parameters @ D.T, inliers, size, float(np.sqrt(variance)), parameters)


def _with_correlation(scores: FloatArray, cells: IntArray) -> FloatArray:
    """Return ``sum(s s')`` ``(d, d)`` of scores ``(n, d)``, enlarged where those of one cell are correlated.

    Cluster-robust covariance ([6]_): neighbouring pairs share the error of the lens or of a moving object.
    Sums over few cells are uncertain, so the result is never smaller than without correlation.
    """
    products = np.asarray(scores.T @ scores)
    sums = np.zeros((int(cells.max()) + 1, scores.shape[1]))
    np.add.at(sums, cells, scores)
    occupied = len(np.unique(cells))
    if occupied <= scores.shape[1]:
        return products
    values, vectors = np.linalg.eigh(products)
    root = vectors * np.sqrt(np.maximum(values, 1e-300))
    whitening = np.linalg.pinv(root)
    correlated = whitening @ (sums.T @ sums) @ whitening.T * (occupied / (occupied - 1.0))
    ratios, axes = np.linalg.eigh(correlated)
    scaled_axes = root @ axes
    return np.asarray(scaled_axes * np.maximum(ratios, 1.0) @ scaled_axes.T)


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

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled sums of the bundle adjustment agree with dense matrices from numeric derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.dfns.bundle_optimization import _kernels as kernels

Array = np.ndarray
NAN = float("nan")
CAM, PT = np.array([0, 1, 2, 0, 2, 1, 2, 0]), np.array([0, 0, 0, 1, 1, 2, 2, 2])
START = np.array([0, 3, 5, 8])
LENS_OF_CAMERA = np.array([0, 1, 0])
#: Adjusted columns of each camera: number in the Jacobian, and in the system. The pose of camera 0 is fixed,
#: cameras 0 and 2 have one lens, and of the lens of camera 1 only k1 and p2 are adjusted.
_LENS = [(6 + i, 12 + i) for i in range(8)]
_ADJUSTED = (_LENS, [(i, i) for i in range(6)] + [(9, 20), (13, 21)], [(i, 6 + i) for i in range(6)] + _LENS)
COLUMNS = np.array([columns + [(0, 0)] * (14 - len(columns)) for columns in _ADJUSTED])
COUNT, SIZE = np.array([len(columns) for columns in _ADJUSTED]), 22


@dataclass
class Scene:
    """Rotations, positions, lenses (fx fy cx cy k1 k2 p1 p2 k3 baseline), points and pixels."""

    R: Array
    c: Array
    V: Array
    X: Array
    pixels: Array


def scene(seed: int) -> Scene:
    rng = np.random.default_rng(seed)
    R = np.array([se3.exp_so3(v) for v in rng.normal(0.0, 0.1, (3, 3))])
    V = np.array([[300.0, 310.0, 160.0, 120.0, -0.2, 0.05, 1e-3, -2e-3, 0.01, 0.3],
                  [250.0, 240.0, 150.0, 110.0, 0.1, -0.02, -1e-3, 3e-3, 0.02, 0.0]])  # fmt: skip
    X = np.column_stack([rng.uniform(-2.0, 2.0, (3, 2)), rng.uniform(4.0, 7.0, 3)])
    built = Scene(R, rng.normal(0.0, 0.3, (3, 3)), V, X, np.zeros((8, 3)))
    built.pixels = np.array([predicted(built, k) for k in range(8)]) + rng.normal(0.0, 2.0, (8, 3))
    built.pixels[LENS_OF_CAMERA[CAM] == 1, 2] = NAN
    built.pixels[3, 2] = NAN
    return built


def predicted(s: Scene, k: int, delta: Array | None = None) -> Array:
    """Return column, row and right-image column (Brown 1966), after changes (17,) of pose, lens and point."""
    delta = np.zeros(17) if delta is None else delta
    fx, fy, cx, cy, k1, k2, p1, p2, k3, baseline = s.V[LENS_OF_CAMERA[CAM[k]]]
    fx, fy, cx, cy = fx + delta[6], fy + delta[6] * fy / fx, cx + delta[7], cy + delta[8]
    k1, k2, k3, p1, p2 = np.array([k1, k2, k3, p1, p2]) + delta[9:14]
    # The rotation of the camera by phi: R_frame_camera becomes Exp(phi) R_frame_camera.
    R = s.R[CAM[k]] @ se3.exp_so3(delta[3:6]).T
    x, y, z = R @ (s.X[PT[k]] + delta[14:] - s.c[CAM[k]] - delta[:3])
    a, b = x / z, y / z
    r2 = a * a + b * b
    radial = 1.0 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = a * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a)
    w = b * radial + p1 * (r2 + 2.0 * b * b) + 2.0 * p2 * a * b
    return np.array([fx * u + cx, fy * w + cy, fx * u + cx - fx * baseline / z])


def robust(kind: int, scale: float, s: float) -> tuple[float, float]:
    """Return the robust cost and weight of a squared residual (Huber 1964; Cauchy)."""
    if kind == kernels.HUBER:
        root = np.sqrt(s)
        return (s, 1.0) if root <= scale else (2.0 * scale * root - scale**2, scale / root)
    if kind == kernels.CAUCHY:
        return scale**2 * np.log(1.0 + s / scale**2), 1.0 / (1.0 + s / scale**2)
    return s, 1.0


def residuals(s: Scene, kind: int, scale: float) -> tuple[Array, Array, float, float, int]:
    return kernels.residuals(CAM, PT, s.pixels, LENS_OF_CAMERA, s.R, s.c, s.V, s.X, kind, scale)


@pytest.mark.parametrize("kind", [kernels.NO_LOSS, kernels.HUBER, kernels.CAUCHY])
@pytest.mark.parametrize("seed", [1, 2])
def test_residuals_and_costs_are_those_of_the_distorted_projection(seed: int, kind: int) -> None:
    s = scene(seed)
    r, weights, cost, plain, behind = residuals(s, kind, 2.5)
    expected = np.nan_to_num(np.array([predicted(s, k) for k in range(8)]) - s.pixels, nan=0.0)
    np.testing.assert_allclose(r, expected, atol=1e-9)
    squares = np.sum(expected**2, axis=1)
    assert squares.min() < 2.5**2 < squares.max()
    losses = np.array([robust(kind, 2.5, square) for square in squares])
    np.testing.assert_allclose(weights, losses[:, 1], rtol=1e-9)
    assert cost == pytest.approx(0.5 * losses[:, 0].sum())
    assert plain == pytest.approx(0.5 * squares.sum())
    assert behind == 0
    s.R[:], s.c[:] = np.eye(3), 0.0
    for depth_m, count in ((0.5, 0), (-0.5, 2)):
        s.X[1] = [0.0, 0.0, depth_m]
        assert residuals(s, kind, 2.5)[4] == count


def dense(s: Scene, weights: Array, r: Array) -> tuple[Array, Array]:
    """Return the matrix (31, 31) and gradient (31,) of all adjusted columns and of the three points."""
    H, g, h = np.zeros((SIZE + 9, SIZE + 9)), np.zeros(SIZE + 9), 1e-6
    for k in range(8):
        J = np.column_stack(
            [(predicted(s, k, h * e) - predicted(s, k, -h * e)) / (2 * h) for e in np.eye(17)]
        )
        J[2] *= not np.isnan(s.pixels[k, 2])
        full = np.zeros((3, SIZE + 9))
        for source, target in COLUMNS[CAM[k], : COUNT[CAM[k]]]:
            full[:, target] = J[:, source]
        full[:, SIZE + 3 * PT[k] : SIZE + 3 * PT[k] + 3] = J[:, 14:]
        H += weights[k] * full.T @ full
        g += weights[k] * full.T @ r[k]
    return H, g


def linearised(s: Scene, fixed: Array) -> tuple[tuple[Array, ...], Array, Array]:
    r, weights, *_ = residuals(s, kernels.CAUCHY, 2.5)
    sparse = kernels.linearise(
        CAM, PT, s.pixels, LENS_OF_CAMERA, s.R, s.c, s.V, s.X, COLUMNS, COUNT, r, weights, fixed, SIZE
    )
    return sparse, *dense(s, weights, r)


def test_the_normal_equations_are_those_of_numeric_derivatives() -> None:
    s = scene(3)
    (H, g, Hp, gp, _), dense_H, dense_g = linearised(s, np.array([0, 0, 1], np.uint8))
    size = float(np.abs(dense_H).max())
    np.testing.assert_allclose(np.tril(H), np.tril(dense_H[:SIZE, :SIZE]), atol=1e-7 * size)
    np.testing.assert_allclose(g, dense_g[:SIZE], atol=1e-5 * float(np.abs(dense_g).max()))
    for p in range(3):
        block = slice(SIZE + 3 * p, SIZE + 3 * p + 3)
        is_free = float(p < 2)
        np.testing.assert_allclose(Hp[p], is_free * dense_H[block, block], rtol=1e-5)
        np.testing.assert_allclose(gp[p], is_free * dense_g[block], rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_the_eliminated_system_has_the_steps_and_covariances_of_the_dense_one(damping: float) -> None:
    """A prior of 100 on each column makes the matrices regular; the third point is fixed."""
    s = scene(4)
    (H, g, Hp, gp, W), dense_H, dense_g = linearised(s, np.array([0, 0, 1], np.uint8))
    H += 100.0 * np.eye(SIZE)
    free_parameters = np.r_[0 : SIZE + 6]
    dense_H = dense_H[np.ix_(free_parameters, free_parameters)] + np.diag([100.0] * SIZE + [0.0] * 6)
    system = dense_H + damping * np.diag(np.diag(dense_H))
    S, b, inverses, is_regular = kernels.eliminate_points(
        START, CAM, COLUMNS, COUNT, H, g, Hp, gp, W, damping
    )
    assert is_regular.tolist() == [True, True, damping > 0.0]
    U, V, Q = system[:SIZE, :SIZE], system[:SIZE, SIZE:], system[SIZE:, SIZE:]
    schur = U - V @ np.linalg.solve(Q, V.T)
    np.testing.assert_allclose(np.tril(S), np.tril(schur), atol=1e-6 * float(np.abs(U).max()))
    expected_b = dense_g[:SIZE] - V @ np.linalg.solve(Q, dense_g[SIZE : SIZE + 6])
    np.testing.assert_allclose(b, expected_b, atol=1e-5 * float(np.abs(dense_g).max()))
    for p in range(2):
        block = slice(3 * p, 3 * p + 3)
        np.testing.assert_allclose(inverses[p], np.linalg.inv(Q[block, block]), rtol=1e-4)
    step = np.linalg.solve(schur, -expected_b)
    points = kernels.point_steps(START, CAM, COLUMNS, COUNT, gp, W, inverses, step)
    expected = np.linalg.solve(Q, -dense_g[SIZE : SIZE + 6] - V.T @ step).reshape(2, 3)
    np.testing.assert_allclose(points[:2], expected, rtol=1e-3, atol=1e-6)
    assert not points[2].any()
    C = np.linalg.inv(schur)
    covariances = kernels.point_covariances(START, CAM, COLUMNS, COUNT, W, inverses, is_regular, C)
    marginals = np.linalg.inv(system)[SIZE:, SIZE:]
    for p in range(2):
        block = slice(3 * p, 3 * p + 3)
        np.testing.assert_allclose(covariances[p], marginals[block, block], rtol=1e-3, atol=1e-9)
    assert np.all(np.isnan(covariances[2])) == (damping == 0.0)


def test_the_inverse_of_a_matrix_is_that_of_numpy_and_zero_if_singular() -> None:
    A = np.random.default_rng(5).normal(size=(3, 5))
    M, out = A @ A.T, np.full((3, 3), NAN)
    assert kernels.invert_3x3(M, out)
    np.testing.assert_allclose(out, np.linalg.inv(M), rtol=1e-10)
    diagonals = [(0, 0, 0), (1, 1, 0), (-1, -1, -1), (-1, -1, 1), (1, -1, -1), (-1, 1, -1)]
    ones = np.ones((3, 3))
    for singular in (*(np.diag(np.array(d, dtype=np.float64)) for d in diagonals), ones):
        out[:] = NAN
        assert not kernels.invert_3x3(singular, out)
        assert not out.any()
    for gap, is_regular in ((2.0**-45, True), (2.0**-48, False)):  # 2.8e-14 and 3.6e-15; the limit is 1e-14
        nearly = np.array([[1.0 + gap, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
        assert kernels.invert_3x3(nearly, out) == is_regular

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The compiled triangulation gives the minimum of the reprojection error, found here by scipy; its limits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from cdff_common.geometry import se3
from cdff_core.dfns.n_view_triangulation import _kernels as kernels
from cdff_core.dfns.n_view_triangulation._kernels import triangulate

Array = np.ndarray
NO_LIMITS = {"iterations": 20, "max_cosine": 1.0, "max_residual_px": 1e6, "min_depth": 0.0}


def rig(seed: int, cameras: int = 5) -> tuple[Array, Array, Array]:
    """Return T_camera_frame (k, 3, 4), positions (k, 3) and focal lengths (k, 2) of cameras."""
    rng = np.random.default_rng(seed)
    poses = [
        se3.transform(se3.exp_so3(rng.normal(0.0, 0.15, 3)), rng.normal(0.0, 0.8, 3)) for _ in range(cameras)
    ]
    P = np.array([se3.inverse(T)[:3] for T in poses])
    return P, np.array([T[:3, 3] for T in poses]), rng.uniform(300.0, 700.0, (cameras, 2))


def projected(P: Array, X: Array) -> Array:
    p = P[..., :3] @ X + P[..., 3]
    return p[..., :2] / p[..., 2:]


def run(
    start: Array, cam: Array, xy: Array, rig_: tuple[Array, Array, Array], **limits: float
) -> tuple[Array, ...]:
    bounds = NO_LIMITS | limits
    return triangulate(
        start, cam, xy, *rig_, int(bounds["iterations"]), bounds["max_cosine"], bounds["max_residual_px"],
        bounds["min_depth"],
    )  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_points_minimise_the_reprojection_error_in_pixels(seed: int) -> None:
    rng = np.random.default_rng(seed)
    P, C, f = rig(seed)
    views = [[0, 1], [0, 1, 2, 3, 4], [4, 2], [1, 3, 4]]
    truth = np.column_stack([rng.uniform(-1.0, 1.0, (4, 2)), rng.uniform(5.0, 9.0, 4)])
    start, cam = np.cumsum([0, *map(len, views)]), np.concatenate(views)
    xy = np.array([projected(P[c], truth[i]) for i, v in enumerate(views) for c in v])
    xy += rng.normal(0.0, 2e-3, xy.shape)
    points, covariances, costs, angles, status = run(start, cam, xy, (P, C, f))
    np.testing.assert_array_equal(status, np.zeros(4))
    for i, v in enumerate(views):
        observed = xy[start[i] : start[i + 1]]
        solution = least_squares(
            lambda X, v=v, observed=observed: (f[v] * (projected(P[v], X) - observed)).ravel(), truth[i],
            xtol=1e-15, ftol=1e-15, gtol=1e-15,
        )  # fmt: skip
        np.testing.assert_allclose(points[i], solution.x, atol=1e-5)
        assert costs[i] == pytest.approx(2.0 * solution.cost, rel=1e-6)
        np.testing.assert_allclose(covariances[i], np.linalg.inv(solution.jac.T @ solution.jac), rtol=1e-3)
        np.testing.assert_array_equal(covariances[i], covariances[i].T)
        rays = C[v] - points[i]
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        assert angles[i] <= np.arccos((rays @ rays.T).min()) + 1e-9
        if len(v) < 4:
            assert angles[i] == pytest.approx(np.arccos((rays @ rays.T).min()), rel=1e-6)


def linear_point(P: Array, xy: Array) -> Array:
    """Return the least-squares point of the cross products, then of those divided by the depth there."""
    rows = np.concatenate([xy[:, :1] * P[:, 2] - P[:, 0], xy[:, 1:] * P[:, 2] - P[:, 1]])
    X = np.linalg.lstsq(rows[:, :3], -rows[:, 3], rcond=None)[0]
    depth = P[:, 2, :3] @ X + P[:, 2, 3]
    rows /= np.tile(depth, 2)[:, None]
    return np.linalg.lstsq(rows[:, :3], -rows[:, 3], rcond=None)[0]


def test_without_iterations_the_point_is_that_of_the_weighted_linear_equations() -> None:
    rng = np.random.default_rng(5)
    P, C, f = rig(5)
    truth = np.array([0.3, -0.2, 6.0])
    xy = projected(P, truth) + rng.normal(0.0, 0.01, (5, 2))
    points, covariances, costs, _, _ = run(np.array([0, 5]), np.arange(5), xy, (P, C, f), iterations=0)
    X = linear_point(P, xy)
    np.testing.assert_allclose(points[0], X, rtol=1e-9)
    residuals = f * (projected(P, X) - xy)
    assert costs[0] == pytest.approx(np.sum(residuals**2), rel=1e-9)
    one = run(np.array([0, 5]), np.arange(5), xy, (P, C, f), iterations=1)[0][0]
    h = 1e-6
    J = np.column_stack(
        [(f * (projected(P, X + h * e) - projected(P, X - h * e)) / (2 * h)).ravel() for e in np.eye(3)]
    )
    np.testing.assert_allclose(covariances[0], np.linalg.inv(J.T @ J), rtol=1e-5)
    np.testing.assert_allclose(one, X - np.linalg.solve(J.T @ J, J.T @ residuals.ravel()), atol=1e-7)


#: Two cameras 1 m apart that look along z, with focal lengths of 100 px.
PAIR = (np.array([np.eye(4)[:3], np.column_stack([np.eye(3), [-1.0, 0.0, 0.0]])]),
        np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), np.full((2, 2), 100.0))  # fmt: skip


def of_pair(X: list[float], shift_y: float = 0.0, **limits: float) -> tuple[int, Array, float, float]:
    """Return status, covariance, cost and angle of a point, seen ``shift_y`` lower by one camera."""
    xy = np.array([projected(P, np.array(X)) for P in PAIR[0]])
    xy[1, 1] += shift_y
    _, covariances, costs, angles, status = run(np.array([0, 2]), np.array([0, 1]), xy, PAIR, **limits)
    return int(status[0]), covariances[0], float(costs[0]), float(angles[0])


def test_limits_of_angle_residual_and_depth() -> None:
    angle = np.arccos(np.cos(2.0 * np.arctan(0.5 / 5.0)))
    assert of_pair([0.5, 0.0, 5.0])[3] == pytest.approx(angle, rel=1e-9)
    for factor, status in ((1.0 - 1e-9, kernels.SMALL_ANGLE), (1.0 + 1e-9, kernels.VALID)):
        result = of_pair([0.5, 0.0, 5.0], max_cosine=float(np.cos(angle)) * factor)
        assert result[0] == status
        assert np.all(np.isfinite(result[1]))
    _, _, cost, _ = of_pair([0.5, 0.0, 5.0], shift_y=0.02)
    rms = np.sqrt(cost / 2.0)
    for factor, status in ((1.0 - 1e-6, kernels.LARGE_RESIDUAL), (1.0 + 1e-6, kernels.VALID)):
        result = of_pair([0.5, 0.0, 5.0], shift_y=0.02, max_residual_px=rms * factor)
        assert result[0] == status
        assert np.all(np.isfinite(result[1]))
    for min_depth, status in ((5.001, kernels.BEHIND), (4.999, kernels.VALID)):
        result = of_pair([0.5, 0.0, 5.0], min_depth=min_depth)
        assert result[0] == status
        assert np.all(np.isfinite(result[1])) == (status == kernels.VALID)


def test_the_reasons_have_an_order_and_points_without_solution_are_not_written() -> None:
    assert of_pair([0.5, 0.0, -5.0])[0] == kernels.BEHIND
    result = of_pair([0.5, 0.0, 5.0], shift_y=0.02, max_cosine=0.5, max_residual_px=1e-3)
    assert result[0] == kernels.SMALL_ANGLE
    xy = np.zeros((5, 2))
    start, cam = np.array([0, 0, 1, 3, 5]), np.array([0, 0, 1, 0, 0])
    points, covariances, costs, angles, status = run(start, cam, xy, PAIR)
    assert status.tolist() == [kernels.FEW_VIEWS, kernels.FEW_VIEWS, kernels.DEGENERATE, kernels.DEGENERATE]
    for values in (points, covariances, costs, angles):
        assert np.all(np.isnan(values))


def test_no_step_increases_the_cost() -> None:
    """Observations with an error of 0.6 on the plane z = 1, so that Gauss-Newton steps overshoot."""
    P, C, f = rig(7)
    rng, overshoots = np.random.default_rng(7), 0
    start, cam = np.array([0, 2]), np.array([0, 3])
    for _ in range(40):
        xy = projected(P[cam], np.array([0.2, 0.1, 4.0])) + rng.normal(0.0, 0.6, (2, 2))
        costs = [float(run(start, cam, xy, (P, C, f), iterations=n)[2][0]) for n in (0, 1, 2, 3, 5, 20)]
        assert np.all(np.diff(costs) <= 1e-9 * np.array(costs[:-1]))
        overshoots += costs[1] == costs[0]
    assert overshoots > 0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.types import BundleObservations, BundleProblem
from cdff_common.types.bundle_ext import FOCAL, K1, K2, PRINCIPAL_POINT, TANGENTIAL
from cdff_common.types.columns import pack_poses
from cdff_core.dfns.bundle_optimization import _poses_first, _solve
from cdff_core.dfns.bundle_optimization._kernels import CAUCHY, HUBER, NO_LOSS
from cdff_core.dfns.bundle_optimization._motions import null_motions
from cdff_core.dfns.bundle_optimization._system import System
from cdff_core.dfns.bundle_optimization.interface import BundleOptimizationInputs, BundleOptimizationOutputs
from cdff_core.dfns.bundle_optimization.schur_lm import SchurLm
from evaluation.bundle_adjustment import consistency
from evaluation.scenes.bundles import cost, ring, solve_with_gtsam

ALL = FOCAL | PRINCIPAL_POINT | K1 | K2 | TANGENTIAL


def solve(
    problem: BundleProblem, dropped: list[int] | None = None, **config: object
) -> tuple[BundleOptimizationOutputs, SchurLm]:
    dfn = SchurLm()
    dfn.configure(config)
    ids = None if dropped is None else np.array(dropped, np.int64)
    return dfn.process(BundleOptimizationInputs(problem=problem, dropped=ids)), dfn


def stereo_ring(seed: int = 0) -> tuple[BundleProblem, np.ndarray, np.ndarray]:
    problem, T, X = ring(8, 60, 6, 0.5, seed)
    observations, lens = problem.observations, [800.0, 800.0, 500.0, 400.0, 0, 0, 0, 0, 0, 0.3]
    p = (
        np.einsum("nij,nj->ni", se3.inverse(T)[observations.cameras][:, :3, :3], X[observations.points])
        + se3.inverse(T)[observations.cameras][:, :3, 3]
    )
    right = (p[:, 0] - 0.3) / p[:, 2] * 800.0 + 500.0 + np.random.default_rng(seed).normal(0, 0.5, len(p))
    pixels = np.column_stack([observations.pixels[:, :2], right])
    result = BundleProblem.from_arrays(
        problem.cameras.matrices,
        lens,
        problem.points.positions,
        (observations.cameras, observations.points),
        pixels,
        frame="site",
    )
    return result, T, X


@pytest.mark.parametrize("loss", [NO_LOSS, HUBER, CAUCHY])
def test_the_gradient_with_respect_to_cameras_lenses_and_points_is_correct(loss: int) -> None:
    problem, *_ = stereo_ring()
    values = problem.lenses.values.copy()
    values[:, 4:9] = [-0.05, 0.01, 0.001, -0.002, 0.003]
    problem = replace(problem, lenses=replace(problem.lenses, values=values))
    system = System.of(problem, ALL | 16, loss, 3.0)
    state = System.initial_estimate(problem)
    r, weights, *_ = system.residuals(state)
    normal = system.normal(state, r, weights)
    rng = np.random.default_rng(1)
    for _ in range(5):
        d, dp = rng.normal(size=system.size), rng.normal(size=state.X.shape)
        d[system.lens_columns[0, 3:]] *= 0.1
        h = 1e-6
        costs = [system.residuals(system.apply_step(state, s * h * d, s * h * dp))[2] for s in (1.0, -1.0)]
        slope = float(normal.g @ d + (normal.gp * dp).sum())
        assert (costs[0] - costs[1]) / (2.0 * h) == pytest.approx(slope, rel=1e-5)


@pytest.mark.req("CDFF-CORE-092")
@pytest.mark.parametrize("free", [0, FOCAL | K1 | K2])
def test_the_cost_equals_that_of_gtsam(free: int) -> None:
    pytest.importorskip("gtsam", reason="peers are installed by make evaluate")
    problem, *_ = ring(8, 80, 6, 1.0, 0, free)
    solution, dfn = solve(problem, tolerance=1e-10)
    peer, _ = solve_with_gtsam(problem, 1e-10)
    assert dfn.metrics["cost_final"] == pytest.approx(cost(peer), rel=1e-4)
    assert cost(solution.problem) == pytest.approx(dfn.metrics["cost_final"])
    assert dfn.metrics["rmse_px"] == pytest.approx(np.sqrt(2.0 * cost(peer) / 480), rel=1e-4)


def test_the_reported_error_is_that_of_the_residuals_and_gross_errors_are_counted() -> None:
    problem, *_ = ring(8, 60, 6, 0.5, 0)
    observations = problem.observations
    pixels = observations.pixels.copy()
    pixels[[5, 40], :2] += 50.0
    problem = replace(
        problem, observations=BundleObservations(observations.cameras, observations.points, pixels)
    )
    solution, dfn = solve(problem, loss="cauchy")
    squares = np.nansum(solution.residuals**2, axis=1)
    assert dfn.metrics["rmse_px"] == pytest.approx(np.sqrt(squares.mean()))
    assert dfn.metrics["cost_final"] == pytest.approx(0.5 * squares.sum())
    assert dfn.metrics["outliers"] == (solution.weights < 0.25).sum() >= 2
    assert dfn.metrics["observations"] == len(observations.cameras)
    assert dfn.metrics["cost_initial"] > dfn.metrics["cost_final"] > dfn.metrics["robust_cost_final"]
    assert dfn.reasons == ()


def long_camera_motion(cameras: int = 60, free: int = FOCAL | K1 | K2) -> BundleProblem:
    """Return a problem of many images of few points, some of them fixed; one point has no observations."""
    problem, *_ = ring(cameras, 12, cameras, 0.5, 0, free)
    observations, X = problem.observations, np.vstack([problem.points.positions, [[0.0, 0.0, 9.0]]])
    fixed_points = [1] + [0] * (len(X) - 1)
    return BundleProblem.from_arrays(
        problem.cameras.matrices,
        problem.lenses.values,
        X,
        (observations.cameras, observations.points),
        observations.pixels,
        frame="site",
        fixed=[0, 0, 1] + [0] * (cameras - 3),
        fixed_points=fixed_points,
        free=free,
    )


@pytest.mark.parametrize("free", [0, FOCAL | K1 | K2])
def test_eliminating_poses_or_points_gives_the_same_step(free: int) -> None:
    problem = long_camera_motion(free=free)
    system, state = System.of(problem, None, HUBER, 1.0), System.initial_estimate(problem)
    assert _poses_first.is_cheaper(system)
    r, weights, *_ = system.residuals(state)
    normal = system.normal(state, r, weights)
    steps = [by(system, normal, 1e-3) for by in (_poses_first.compute_step, _solve._points_first_step)]
    assert steps[0][0] == pytest.approx(steps[1][0], rel=1e-6, abs=1e-9)
    assert steps[0][1] == pytest.approx(steps[1][1], rel=1e-6, abs=1e-9)
    assert not steps[0][1][[0, -1]].any()


def test_a_long_camera_motion_reaches_the_cost_of_gtsam() -> None:
    pytest.importorskip("gtsam", reason="peers are installed by make evaluate")
    problem, *_ = ring(60, 12, 60, 0.5, 0)
    assert _poses_first.is_cheaper(System.of(problem, None, NO_LOSS, 1.0))
    solution, _ = solve(problem, tolerance=1e-9)
    assert cost(solution.problem) == pytest.approx(cost(solve_with_gtsam(problem, 1e-9)[0]), rel=1e-6)


def test_covariances_are_consistent_with_the_errors() -> None:
    result = consistency(12)
    assert 0.75 < result["poses"]["mean"] < 1.4
    assert 0.85 < result["points"]["mean"] < 1.2


def test_the_gauge_fixes_the_first_camera_and_for_monocular_problems_one_distance() -> None:
    problem, *_ = ring(8, 60, 6)
    solution, _ = solve(problem)
    first, far = (int(i) for i in solution.gauge)
    before, after = problem.cameras.matrices, solution.problem.cameras.matrices
    assert after[first] == pytest.approx(before[first], abs=1e-9)
    gap = [np.linalg.norm(T[far, :3, 3] - T[first, :3, 3]) for T in (before, after)]
    assert gap[0] == pytest.approx(gap[1])
    assert not solution.pose_covariances[first].any()
    along = after[far, :3, 3] - after[first, :3, 3]
    C = solution.pose_covariances[far, :3, :3]
    assert along @ C @ along / (along @ along) < 1e-9 * np.trace(C)
    stereo, T, _ = stereo_ring()
    solution, _ = solve(stereo)
    assert len(solution.gauge) == 1
    scale = [np.linalg.norm(t[4, :3, 3] - t[0, :3, 3]) for t in (T, solution.problem.cameras.matrices)]
    assert scale[0] == pytest.approx(scale[1], rel=0.01)


def with_fixed(problem: BundleProblem, cameras: int, points: int) -> BundleProblem:
    """Return a problem with the first ``cameras`` cameras and the first ``points`` points fixed."""
    observations, T, X = problem.observations, problem.cameras.matrices, problem.points.positions
    return BundleProblem.from_arrays(
        T,
        problem.lenses.values,
        X,
        (observations.cameras, observations.points),
        observations.pixels,
        frame="site",
        fixed=np.arange(len(T)) < cameras,
        fixed_points=np.arange(len(X)) < points,
    )


#: Gauge directions for single images and for rectified pairs, by numbers of fixed cameras and fixed points.
GAUGE_DIRECTIONS = {
    (0, 0): (7, 6),
    (0, 1): (4, 3),
    (0, 2): (1, 1),
    (0, 3): (0, 0),
    (1, 0): (1, 0),
    (1, 1): (0, 0),
    (1, 2): (0, 0),
    (1, 3): (0, 0),
}


@pytest.mark.req("CDFF-CORE-092")
@pytest.mark.parametrize("stereo", [False, True], ids=["mono", "stereo"])
@pytest.mark.parametrize(("cameras", "points"), GAUGE_DIRECTIONS)
def test_fixed_variables_are_unchanged_and_only_the_remaining_gauge_is_fixed(
    cameras: int, points: int, stereo: bool
) -> None:
    problem = with_fixed((stereo_ring() if stereo else ring(8, 60, 6))[0], cameras, points)
    solution, dfn = solve(problem)
    T, X, T_solved = problem.cameras.matrices, problem.points.positions, solution.problem.cameras.matrices
    assert np.array_equal(solution.problem.points.positions[:points], X[:points])
    assert np.abs(T_solved[:cameras] - T[:cameras]).max(initial=0.0) < 1e-12
    assert cost(solution.problem) == pytest.approx(dfn.metrics["cost_final"], rel=1e-9)
    assert dfn.metrics["gauge_directions"] == GAUGE_DIRECTIONS[cameras, points][int(stereo)]
    assert dfn.reasons == ()
    assert np.linalg.eigvalsh(solution.pose_covariances).min() > -1e-12
    assert not solution.pose_covariances[:cameras].any()
    assert not solution.point_covariances[:points].any()
    assert np.trace(solution.point_covariances[points:], axis1=1, axis2=2).min() > 0.0
    if len(solution.gauge) > 1:
        first, far = (int(i) for i in solution.gauge)
        gaps = [np.linalg.norm(t[far, :3, 3] - t[first, :3, 3]) for t in (T, T_solved)]
        assert gaps[0] == pytest.approx(gaps[1])


def test_the_gauge_has_three_rotations_with_one_fixed_point_and_one_with_two() -> None:
    for points, axes in ((1, np.eye(3)), (2, None)):
        problem = with_fixed(stereo_ring()[0], 0, points)
        solution, _ = solve(problem)
        first = int(solution.gauge[0])  # camera whose pose the gauge fixes
        if axes is None:
            axes = np.diff(problem.points.positions[:2], axis=0)
            axes /= np.linalg.norm(axes)
        R = se3.log_so3(
            solution.problem.cameras.matrices[first, :3, :3] @ problem.cameras.matrices[first, :3, :3].T
        )
        C = solution.pose_covariances[first]
        assert np.abs(axes @ R).max() < 1e-12
        assert np.abs(axes @ C[3:, 3:] @ axes.T).max() < 1e-9 * np.trace(C[3:, 3:]) + 1e-20
        assert np.trace(C[:3, :3]) > 0.0


def test_the_gauge_has_one_rotation_with_three_collinear_fixed_points() -> None:
    problem, *_ = ring(8, 60, 6)
    X = problem.points.positions.copy()
    X[1] = 0.5 * (X[0] + X[2])
    solution, dfn = solve(with_fixed(replace(problem, points=replace(problem.points, positions=X)), 0, 3))
    assert dfn.metrics["gauge_directions"] == 1.0
    assert np.isfinite(solution.pose_covariances).all()


def test_disconnected_variables_have_no_covariance_and_a_reason() -> None:
    problem, *_ = ring(8, 60, 6)
    observations = problem.observations
    T, X = problem.cameras.matrices, problem.points.positions
    two_components = BundleProblem.from_arrays(
        np.concatenate([T, T]),
        problem.lenses.values,
        np.concatenate([X, X]),
        (
            np.concatenate([observations.cameras, observations.cameras + 8]),
            np.concatenate([observations.points, observations.points + 60]),
        ),
        np.concatenate([observations.pixels, observations.pixels]),
        frame="site",
    )
    few = np.flatnonzero((observations.cameras != 5) | (np.cumsum(observations.cameras == 5) <= 2))
    weakly_connected = replace(
        problem,
        observations=BundleObservations(
            observations.cameras[few], observations.points[few], observations.pixels[few]
        ),
    )
    for deficient in (two_components, weakly_connected):
        solution, dfn = solve(deficient)
        assert np.isnan(solution.pose_covariances).all()
        assert dfn.reasons == ("degenerate:directions_free",)


def test_robust_losses_reduce_the_effect_of_outliers() -> None:
    problem, T_true, X_true = ring(8, 80, 6, 0.5, 3)
    observations = problem.observations
    pixels = observations.pixels.copy()
    wrong = np.random.default_rng(0).choice(len(pixels), 30, replace=False)
    pixels[wrong, :2] += 60.0
    problem = replace(
        problem, observations=BundleObservations(observations.cameras, observations.points, pixels)
    )
    is_fixed = np.zeros(8)
    is_fixed[:2] = 1
    T = problem.cameras.matrices
    T[:2] = T_true[:2]
    problem = BundleProblem.from_arrays(
        T,
        [800.0, 800, 500, 400],
        problem.points.positions,
        (observations.cameras, observations.points),
        pixels,
        frame="site",
        fixed=is_fixed,
    )
    errors = {}
    for loss in ("none", "huber", "cauchy"):
        solution, dfn = solve(problem, loss=loss)
        errors[loss] = np.median(np.linalg.norm(solution.problem.points.positions - X_true, axis=1))
        assert dfn.metrics["robust_cost_final"] <= dfn.metrics["cost_final"] + 1e-9
    assert errors["cauchy"] < 0.5 * errors["none"]
    assert errors["huber"] < errors["none"]
    assert (solution.weights[wrong] < 0.1).all()


def test_lenses_are_adjusted_if_the_problem_or_the_configuration_requests_it() -> None:
    problem, *_ = ring(8, 80, 6, 0.3)
    values = problem.lenses.values.copy()
    values[0, :2] *= 1.02
    inaccurate = replace(problem, lenses=replace(problem.lenses, values=values))
    assert solve(inaccurate)[0].problem.lenses.values[0, 0] == pytest.approx(816.0)
    assert solve(inaccurate, lenses="focal")[0].problem.lenses.values[0, :2] == pytest.approx(
        [800.0, 800.0], rel=0.005
    )
    radial = solve(inaccurate, lenses="all")[0].problem.lenses.values[0]
    assert radial[4] != 0.0
    assert radial[9] == 0.0


def test_marginalised_cameras_become_an_equivalent_prior() -> None:
    problem, *_ = ring(10, 120, 5, 0.5, 1)
    full, _ = solve(problem, tolerance=1e-12)
    remaining = solve(full.problem, dropped=[7, 8, 9], max_iterations=0)[0].remaining
    assert remaining is not None
    assert remaining.cameras.ids.tolist() == list(range(7))
    assert np.linalg.eigvalsh(remaining.prior.matrix).min() > -1e-6 * np.abs(remaining.prior.matrix).max()
    resolved, _ = solve(remaining, tolerance=1e-12)
    retained = full.problem.cameras.matrices[:7]
    assert np.abs(resolved.problem.cameras.matrices - retained).max() < 1e-4
    without_prior = replace(remaining, prior=type(remaining.prior)())
    shift = np.abs(solve(without_prior, tolerance=1e-12)[0].problem.cameras.matrices - retained).max()
    assert shift > 10.0 * np.abs(resolved.problem.cameras.matrices - retained).max()


def test_a_fixed_camera_that_is_dropped_leaves_the_other_cameras_in_place() -> None:
    """Its pose is known, so that nothing is eliminated but the points that it observed."""
    problem, *_ = ring(6, 80, 6, 0.5, 1)
    is_fixed = np.zeros(6, np.uint8)
    is_fixed[[0, 5]] = 1
    full, _ = solve(replace(problem, cameras=replace(problem.cameras, fixed=is_fixed)), tolerance=1e-12)
    remaining = solve(full.problem, dropped=[5], max_iterations=0)[0].remaining
    assert remaining is not None
    assert remaining.prior.cameras.tolist() == [1, 2, 3, 4]
    resolved, _ = solve(remaining, tolerance=1e-12)
    assert np.abs(resolved.problem.cameras.matrices - full.problem.cameras.matrices[:5]).max() < 1e-4


@pytest.mark.req("CDFF-CORE-092")
@pytest.mark.parametrize("stereo", [False, True], ids=["mono", "stereo"])
def test_a_sliding_window_keeps_its_gauge_and_covariances(stereo: bool) -> None:
    rng = np.random.default_rng(4)
    problem = stereo_ring()[0] if stereo else ring(8, 60, 6, 0.5, 1)[0]
    full, dfn = solve(problem, tolerance=1e-12)
    window, variance = full.problem, dfn.metrics["unit_variance"]
    for dropped in (7, 6, 5):
        window = solve(window, dropped=[dropped], max_iterations=0)[0].remaining
        assert window is not None
        T = window.cameras.matrices
        for row in np.setdiff1d(np.arange(len(T)), full.gauge):  # small changes, as from new observations
            T[row] = se3.transform(
                se3.exp_so3(rng.normal(0, 1e-3, 3)) @ T[row, :3, :3], T[row, :3, 3] + rng.normal(0, 1e-2, 3)
            )
        window = replace(window, cameras=replace(window.cameras, poses=pack_poses(T, "perturbed")))
        resolved, dfn = solve(window, tolerance=1e-12)
        window = resolved.problem
        assert dfn.reasons == (() if len(window.observations.cameras) else ("underdetermined",))
        assert dfn.metrics["gauge_directions"] == (6.0 if stereo else 7.0)
        if not len(window.observations.cameras):
            break
        assert resolved.gauge.tolist() == full.gauge.tolist()
        before, after = (
            full.pose_covariances[:dropped] / variance,
            resolved.pose_covariances / dfn.metrics["unit_variance"],
        )
        assert np.abs(after - before).max() < 0.02 * np.abs(before).max()
        assert np.abs(window.cameras.matrices - full.problem.cameras.matrices[:dropped]).max() < 1e-3
    assert 5 <= dropped < 7


@pytest.mark.parametrize("stereo", [False, True], ids=["mono", "stereo"])
def test_a_prior_excludes_cameras_without_common_points(
    stereo: bool,
) -> None:
    problem = stereo_ring()[0] if stereo else ring(8, 60, 6, 0.5, 1)[0]
    o = problem.observations
    shared = (o.cameras == 3) & np.isin(o.points, o.points[o.cameras == 7])
    retained = BundleObservations(o.cameras[~shared], o.points[~shared], o.pixels[~shared])
    window = solve(replace(problem, observations=retained), dropped=[7])[0].remaining
    assert window is not None
    H = np.array(window.prior.matrix)
    assert np.abs(H[18:24]).max() < 1e-9 * np.abs(H).max()
    sizes = np.tile(np.sqrt(np.diag(H).reshape(-1, 2, 3).max(axis=(0, 2))).repeat(3), 7)
    noise = 1e-16 * np.outer(sizes, sizes) * np.random.default_rng(0).normal(size=H.shape)
    window = replace(window, prior=replace(window.prior, information=(H + noise + noise.T).reshape(-1)))
    for dropped in (6, 5):
        solution, dfn = solve(window, dropped=[dropped])
        assert dfn.metrics["gauge_directions"] == (6.0 if stereo else 7.0)
        window = solution.remaining
        assert window is not None


def test_steps_far_from_the_prior_are_rejected() -> None:
    full, _ = solve(ring(10, 120, 5, 0.5, 1)[0])
    remaining = solve(full.problem, dropped=[7, 8, 9], max_iterations=0)[0].remaining
    assert remaining is not None
    system, state = System.of(remaining, 0, NO_LOSS, 1.0), System.initial_estimate(remaining)
    c = state.c.copy()
    c[0] = 1e12
    assert system.residuals(replace(state, c=c))[2] == np.inf
    T = remaining.cameras.matrices
    T[0, :3, 3] = 1e12
    distant = replace(remaining, cameras=replace(remaining.cameras, poses=pack_poses(T, "distant")))
    with pytest.raises(InputError, match="too far"):
        solve(distant, dropped=[6], max_iterations=0)


def test_a_prior_without_fixed_gauge_is_invariant_to_similarity_transforms() -> None:
    full, _ = solve(ring(10, 120, 5, 0.5, 1)[0])
    remaining = solve(full.problem, dropped=[7, 8, 9], max_iterations=0)[0].remaining
    assert remaining is not None
    T, X, R = remaining.cameras.matrices, remaining.points.positions, se3.exp_so3([0.3, -0.5, 0.4])
    T[:, :3, 3] = 1.3 * T[:, :3, 3] @ R.T + [5.0, -70.0, 9.0]
    T[:, :3, :3] = R @ T[:, :3, :3]
    transformed_problem = replace(
        remaining,
        cameras=replace(remaining.cameras, poses=pack_poses(T, "moved")),
        points=replace(remaining.points, positions=1.3 * X @ R.T + [5.0, -70.0, 9.0]),
    )
    original, transformed = (
        System.of(problem, 0, NO_LOSS, 1.0) for problem in (remaining, transformed_problem)
    )
    state = System.initial_estimate(transformed_problem)
    assert transformed.residuals(state)[2] == pytest.approx(
        original.residuals(System.initial_estimate(remaining))[2], rel=1e-9
    )
    rng, h = np.random.default_rng(1), 1e-6
    state = transformed.apply_step(state, 1e-4 * rng.normal(size=transformed.size), np.zeros_like(state.X))
    normal = transformed.normal(state, *transformed.residuals(state)[:2])
    for _ in range(3):
        d, dp = rng.normal(size=transformed.size), rng.normal(size=state.X.shape)
        costs = [
            transformed.residuals(transformed.apply_step(state, s * h * d, s * h * dp))[2]
            for s in (1.0, -1.0)
        ]
        slope = float(normal.g @ d + (normal.gp * dp).sum())
        assert (costs[0] - costs[1]) / (2.0 * h) == pytest.approx(slope, rel=1e-3)


def test_the_variance_of_unit_weight_includes_the_prior() -> None:
    variances = []
    for seed in range(6):
        problem, *_ = ring(10, 120, 5, 0.5, seed)
        full, _ = solve(problem)
        remaining = solve(full.problem, dropped=[7, 8, 9], max_iterations=0)[0].remaining
        assert remaining is not None
        variances.append(solve(remaining)[1].metrics["unit_variance"])
    assert np.mean(variances) == pytest.approx(0.25, rel=0.15)


def test_fewer_residuals_than_unknowns_and_invalid_numbers_are_reported() -> None:
    T = np.stack([np.eye(4), se3.transform(np.eye(3), [1.0, 0, 0])])
    few = BundleProblem.from_arrays(
        T,
        [700.0, 700, 0, 0],
        [[0.0, 0, 5], [1, 0, 5]],
        ([0, 1, 0, 1], [0, 0, 1, 1]),
        np.zeros((4, 2)),
        frame="site",
    )
    solution, dfn = solve(few)
    assert "underdetermined" in dfn.reasons
    assert np.isnan(solution.pose_covariances).any()
    pixels = np.full((4, 2), np.nan)
    o = few.observations
    bad = BundleProblem.from_arrays(
        T, [700.0] * 4, np.ones((2, 3)), (o.cameras, o.points), pixels, frame="site"
    )
    with pytest.raises(InputError, match="finite"):
        solve(bad)
    with pytest.raises(InputError, match="dropped"):
        solve(few, dropped=[99])


def test_the_gauge_is_determined_with_memory_linear_in_the_points(
    rng: np.random.Generator,
) -> None:
    rows = np.zeros((6000, 7))
    rows[:, :3] = rng.normal(size=(6000, 3))
    tracemalloc.start()
    try:
        gauge_motions = null_motions(rows)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert gauge_motions.shape == (4, 7)
    assert np.abs(gauge_motions[:, :3]).max() < 1e-9
    assert peak < 10 * rows.nbytes

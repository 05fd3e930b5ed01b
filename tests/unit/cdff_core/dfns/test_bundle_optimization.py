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
from cdff_core.dfns.bundle_optimization._interface import BundleOptimizationInputs, BundleOptimizationOutputs
from cdff_core.dfns.bundle_optimization._kernels import CAUCHY, HUBER, NO_LOSS
from cdff_core.dfns.bundle_optimization._motions import unheld
from cdff_core.dfns.bundle_optimization._system import System
from cdff_core.dfns.bundle_optimization.schur_lm import SchurLm
from cdff_dev.evaluate._bundles import by_gtsam, cost, ring
from cdff_dev.evaluate.bundle_adjustment import consistency

ALL = FOCAL | PRINCIPAL_POINT | K1 | K2 | TANGENTIAL


def solved(
    problem: BundleProblem, dropped: list[int] | None = None, **config: object
) -> tuple[BundleOptimizationOutputs, SchurLm]:
    dfn = SchurLm()
    dfn.configure(config)
    ids = None if dropped is None else np.array(dropped, np.int64)
    return dfn.process(BundleOptimizationInputs(problem, ids)), dfn


def stereo_ring(seed: int = 0) -> tuple[BundleProblem, np.ndarray, np.ndarray]:
    problem, T, X = ring(8, 60, 6, 0.5, seed)
    o, lens = problem.observations, [800.0, 800.0, 500.0, 400.0, 0, 0, 0, 0, 0, 0.3]
    p = np.einsum("nij,nj->ni", se3.inverse(T)[o.cameras][:, :3, :3], X[o.points]) + se3.inverse(T)[o.cameras][:, :3, 3]
    right = (p[:, 0] - 0.3) / p[:, 2] * 800.0 + 500.0 + np.random.default_rng(seed).normal(0, 0.5, len(p))
    pixels = np.column_stack([o.pixels[:, :2], right])
    made = BundleProblem.from_arrays(
        problem.cameras.matrices, lens, problem.points.positions, (o.cameras, o.points), pixels, frame="site"
    )
    return made, T, X


@pytest.mark.parametrize("loss", [NO_LOSS, HUBER, CAUCHY])
def test_the_gradient_of_cameras_lenses_and_points_is_that_of_the_cost(loss: int) -> None:
    problem, *_ = stereo_ring()
    values = problem.lenses.values.copy()
    values[:, 4:9] = [-0.05, 0.01, 0.001, -0.002, 0.003]
    problem = replace(problem, lenses=replace(problem.lenses, values=values))
    system = System.of(problem, ALL | 16, loss, 3.0)
    at = System.first(problem)
    r, weights, *_ = system.residuals(at)
    normal = system.normal(at, r, weights)
    rng = np.random.default_rng(1)
    for _ in range(5):
        d, dp = rng.normal(size=system.size), rng.normal(size=at.X.shape)
        d[system.lens_columns[0, 3:]] *= 0.1
        h = 1e-6
        costs = [system.residuals(system.moved(at, s * h * d, s * h * dp))[2] for s in (1.0, -1.0)]
        slope = float(normal.g @ d + (normal.gp * dp).sum())
        assert (costs[0] - costs[1]) / (2.0 * h) == pytest.approx(slope, rel=1e-5)


@pytest.mark.req("CDFF-CORE-092")
@pytest.mark.parametrize("free", [0, FOCAL | K1 | K2])
def test_the_cost_is_that_of_gtsam_on_the_same_objective(free: int) -> None:
    problem, *_ = ring(8, 80, 6, 1.0, 0, free)
    found, dfn = solved(problem, tolerance=1e-10)
    peer, _ = by_gtsam(problem, 1e-10)
    assert dfn.metrics["cost_final"] == pytest.approx(cost(peer), rel=1e-4)
    assert cost(found.problem) == pytest.approx(dfn.metrics["cost_final"])
    assert dfn.metrics["rmse_px"] == pytest.approx(np.sqrt(2.0 * cost(peer) / 480), rel=1e-4)


def motion(cameras: int = 60, free: int = FOCAL | K1 | K2) -> BundleProblem:
    """Many images of few points, some of them held; one point that nobody saw."""
    problem, *_ = ring(cameras, 12, cameras, 0.5, 0, free)
    o, X = problem.observations, np.vstack([problem.points.positions, [[0.0, 0.0, 9.0]]])
    held = [1] + [0] * (len(X) - 1)
    return BundleProblem.from_arrays(
        problem.cameras.matrices, problem.lenses.values, X, (o.cameras, o.points), o.pixels, frame="site",
        fixed=[0, 0, 1] + [0] * (cameras - 3), fixed_points=held, free=free,
    )  # fmt: skip


@pytest.mark.parametrize("free", [0, FOCAL | K1 | K2])
def test_eliminating_poses_leads_to_the_same_step_as_eliminating_points(free: int) -> None:
    problem = motion(free=free)
    system, at = System.of(problem, None, HUBER, 1.0), System.first(problem)
    assert _poses_first.is_smaller(system)
    r, weights, *_ = system.residuals(at)
    normal = system.normal(at, r, weights)
    steps = [by(system, normal, 1e-3) for by in (_poses_first.stepped, _solve._points_first)]
    assert steps[0][0] == pytest.approx(steps[1][0], rel=1e-6, abs=1e-9)
    assert steps[0][1] == pytest.approx(steps[1][1], rel=1e-6, abs=1e-9)
    assert not steps[0][1][[0, -1]].any()


def test_a_long_camera_motion_over_few_points_ends_at_the_cost_of_gtsam() -> None:
    problem, *_ = ring(60, 12, 60, 0.5, 0)
    assert _poses_first.is_smaller(System.of(problem, None, NO_LOSS, 1.0))
    found, _ = solved(problem, tolerance=1e-9)
    assert cost(found.problem) == pytest.approx(cost(by_gtsam(problem, 1e-9)[0]), rel=1e-6)


def test_covariances_are_as_large_as_the_errors() -> None:
    figures = consistency(12)
    assert 0.75 < figures["poses"]["mean"] < 1.4
    assert 0.85 < figures["points"]["mean"] < 1.2


def test_the_gauge_keeps_the_first_camera_and_a_distance_for_single_images_only() -> None:
    problem, *_ = ring(8, 60, 6)
    found, _ = solved(problem)
    first, far = (int(i) for i in found.gauge)
    before, after = problem.cameras.matrices, found.problem.cameras.matrices
    assert after[first] == pytest.approx(before[first], abs=1e-9)
    gap = [np.linalg.norm(T[far, :3, 3] - T[first, :3, 3]) for T in (before, after)]
    assert gap[0] == pytest.approx(gap[1])
    assert not found.pose_covariances[first].any()
    along = after[far, :3, 3] - after[first, :3, 3]
    C = found.pose_covariances[far, :3, :3]
    assert along @ C @ along / (along @ along) < 1e-9 * np.trace(C)
    stereo, T, _ = stereo_ring()
    found, _ = solved(stereo)
    assert len(found.gauge) == 1
    scale = [np.linalg.norm(t[4, :3, 3] - t[0, :3, 3]) for t in (T, found.problem.cameras.matrices)]
    assert scale[0] == pytest.approx(scale[1], rel=0.01)


def with_fixed(problem: BundleProblem, cameras: int, points: int) -> BundleProblem:
    """The first so many cameras and points fixed where they are."""
    o, T, X = problem.observations, problem.cameras.matrices, problem.points.positions
    return BundleProblem.from_arrays(
        T, problem.lenses.values, X, (o.cameras, o.points), o.pixels, frame="site",
        fixed=np.arange(len(T)) < cameras, fixed_points=np.arange(len(X)) < points,
    )  # fmt: skip


#: Directions that stay free: of single images and of rectified pairs, by fixed cameras and fixed points.
FREE = {
    (0, 0): (7, 6), (0, 1): (4, 3), (0, 2): (1, 1), (0, 3): (0, 0),
    (1, 0): (1, 0), (1, 1): (0, 0), (1, 2): (0, 0), (1, 3): (0, 0),
}  # fmt: skip


@pytest.mark.req("CDFF-CORE-092")
@pytest.mark.parametrize("stereo", [False, True], ids=["mono", "stereo"])
@pytest.mark.parametrize(("cameras", "points"), FREE)
def test_what_is_fixed_stays_and_only_what_that_leaves_free_is_held(cameras: int, points: int, stereo: bool) -> None:
    problem = with_fixed((stereo_ring() if stereo else ring(8, 60, 6))[0], cameras, points)
    found, dfn = solved(problem)
    T, X, T_found = problem.cameras.matrices, problem.points.positions, found.problem.cameras.matrices
    assert np.array_equal(found.problem.points.positions[:points], X[:points])
    assert np.abs(T_found[:cameras] - T[:cameras]).max(initial=0.0) < 1e-12
    assert cost(found.problem) == pytest.approx(dfn.metrics["cost_final"], rel=1e-9)
    assert dfn.metrics["gauge_directions"] == FREE[cameras, points][int(stereo)]
    assert dfn.reasons == ()
    assert np.linalg.eigvalsh(found.pose_covariances).min() > -1e-12
    assert not found.pose_covariances[:cameras].any()
    assert not found.point_covariances[:points].any()
    assert np.trace(found.point_covariances[points:], axis1=1, axis2=2).min() > 0.0
    if len(found.gauge) > 1:
        first, far = (int(i) for i in found.gauge)
        gaps = [np.linalg.norm(t[far, :3, 3] - t[first, :3, 3]) for t in (T, T_found)]
        assert gaps[0] == pytest.approx(gaps[1])


def test_one_fixed_point_keeps_the_first_camera_turned_and_two_keep_it_from_turning_about_their_line() -> None:
    for points, axes in ((1, np.eye(3)), (2, None)):
        problem = with_fixed(stereo_ring()[0], 0, points)
        found, _ = solved(problem)
        first = int(found.gauge[0])
        if axes is None:
            axes = np.diff(problem.points.positions[:2], axis=0)
            axes /= np.linalg.norm(axes)
        turned = se3.log_so3(found.problem.cameras.matrices[first, :3, :3] @ problem.cameras.matrices[first, :3, :3].T)
        C = found.pose_covariances[first]
        assert np.abs(axes @ turned).max() < 1e-12
        assert np.abs(axes @ C[3:, 3:] @ axes.T).max() < 1e-9 * np.trace(C[3:, 3:]) + 1e-20
        assert np.trace(C[:3, :3]) > 0.0


def test_three_fixed_points_on_a_line_leave_a_turn_about_it() -> None:
    problem, *_ = ring(8, 60, 6)
    X = problem.points.positions.copy()
    X[1] = 0.5 * (X[0] + X[2])
    found, dfn = solved(with_fixed(replace(problem, points=replace(problem.points, positions=X)), 0, 3))
    assert dfn.metrics["gauge_directions"] == 1.0
    assert np.isfinite(found.pose_covariances).all()


def test_what_nothing_joins_has_no_covariances_and_a_reason() -> None:
    problem, *_ = ring(8, 60, 6)
    o = problem.observations
    T, X = problem.cameras.matrices, problem.points.positions
    apart = BundleProblem.from_arrays(
        np.concatenate([T, T]), problem.lenses.values, np.concatenate([X, X]),
        (np.concatenate([o.cameras, o.cameras + 8]), np.concatenate([o.points, o.points + 60])),
        np.concatenate([o.pixels, o.pixels]), frame="site",
    )  # fmt: skip
    few = np.flatnonzero((o.cameras != 5) | (np.cumsum(o.cameras == 5) <= 2))
    loose = replace(problem, observations=BundleObservations(o.cameras[few], o.points[few], o.pixels[few]))
    for unjoined in (apart, loose):
        found, dfn = solved(unjoined)
        assert np.isnan(found.pose_covariances).all()
        assert dfn.reasons == ("degenerate:directions_free",)


def test_a_robust_loss_bears_wrong_observations() -> None:
    problem, T_true, X_true = ring(8, 80, 6, 0.5, 3)
    o = problem.observations
    pixels = o.pixels.copy()
    wrong = np.random.default_rng(0).choice(len(pixels), 30, replace=False)
    pixels[wrong, :2] += 60.0
    problem = replace(problem, observations=BundleObservations(o.cameras, o.points, pixels))
    fixed = np.zeros(8)
    fixed[:2] = 1
    T = problem.cameras.matrices
    T[:2] = T_true[:2]
    problem = BundleProblem.from_arrays(
        T, [800.0, 800, 500, 400], problem.points.positions, (o.cameras, o.points), pixels, frame="site", fixed=fixed
    )
    errors = {}
    for loss in ("none", "huber", "cauchy"):
        found, dfn = solved(problem, loss=loss)
        errors[loss] = np.median(np.linalg.norm(found.problem.points.positions - X_true, axis=1))
        assert dfn.metrics["robust_cost_final"] <= dfn.metrics["cost_final"] + 1e-9
    assert errors["cauchy"] < 0.5 * errors["none"]
    assert errors["huber"] < errors["none"]
    assert (found.weights[wrong] < 0.1).all()


def test_lenses_are_adjusted_as_the_problem_or_the_configuration_says() -> None:
    problem, *_ = ring(8, 80, 6, 0.3)
    values = problem.lenses.values.copy()
    values[0, :2] *= 1.02
    off = replace(problem, lenses=replace(problem.lenses, values=values))
    assert solved(off)[0].problem.lenses.values[0, 0] == pytest.approx(816.0)
    assert solved(off, lenses="focal")[0].problem.lenses.values[0, :2] == pytest.approx([800.0, 800.0], rel=0.005)
    radial = solved(off, lenses="all")[0].problem.lenses.values[0]
    assert radial[4] != 0.0
    assert radial[9] == 0.0


def test_marginalised_cameras_become_a_prior_that_stands_for_them() -> None:
    problem, *_ = ring(10, 120, 5, 0.5, 1)
    whole, _ = solved(problem, tolerance=1e-12)
    remaining = solved(whole.problem, dropped=[7, 8, 9], max_iterations=0)[0].remaining
    assert remaining is not None
    assert remaining.cameras.ids.tolist() == list(range(7))
    assert np.linalg.eigvalsh(remaining.prior.matrix).min() > -1e-6 * np.abs(remaining.prior.matrix).max()
    again, _ = solved(remaining, tolerance=1e-12)
    kept = whole.problem.cameras.matrices[:7]
    assert np.abs(again.problem.cameras.matrices - kept).max() < 1e-4
    alone = replace(remaining, prior=type(remaining.prior)())
    shift = np.abs(solved(alone, tolerance=1e-12)[0].problem.cameras.matrices - kept).max()
    assert shift > 10.0 * np.abs(again.problem.cameras.matrices - kept).max()


@pytest.mark.req("CDFF-CORE-092")
@pytest.mark.parametrize("stereo", [False, True], ids=["mono", "stereo"])
def test_a_window_that_slides_keeps_its_gauge_and_its_covariances(stereo: bool) -> None:
    rng = np.random.default_rng(4)
    problem = stereo_ring()[0] if stereo else ring(8, 60, 6, 0.5, 1)[0]
    whole, dfn = solved(problem, tolerance=1e-12)
    left, variance = whole.problem, dfn.metrics["unit_variance"]
    for dropped in (7, 6, 5):
        left = solved(left, dropped=[dropped], max_iterations=0)[0].remaining
        assert left is not None
        T = left.cameras.matrices
        for row in np.setdiff1d(np.arange(len(T)), whole.gauge):  # as new observations would
            T[row] = se3.transform(
                se3.exp_so3(rng.normal(0, 1e-3, 3)) @ T[row, :3, :3], T[row, :3, 3] + rng.normal(0, 1e-2, 3)
            )
        left = replace(left, cameras=replace(left.cameras, poses=pack_poses(T, "shaken")))
        again, dfn = solved(left, tolerance=1e-12)
        left = again.problem
        assert dfn.reasons == (() if len(left.observations.cameras) else ("underdetermined",))
        assert dfn.metrics["gauge_directions"] == (6.0 if stereo else 7.0)
        if not len(left.observations.cameras):
            break
        assert again.gauge.tolist() == whole.gauge.tolist()
        before, after = (
            whole.pose_covariances[:dropped] / variance,
            again.pose_covariances / dfn.metrics["unit_variance"],
        )
        assert np.abs(after - before).max() < 0.02 * np.abs(before).max()
        assert np.abs(left.cameras.matrices - whole.problem.cameras.matrices[:dropped]).max() < 1e-3
    assert 5 <= dropped < 7


@pytest.mark.parametrize("stereo", [False, True], ids=["mono", "stereo"])
def test_a_prior_learns_nothing_of_a_camera_that_shares_no_point_with_those_that_are_gone(stereo: bool) -> None:
    problem = stereo_ring()[0] if stereo else ring(8, 60, 6, 0.5, 1)[0]
    o = problem.observations
    shared = (o.cameras == 3) & np.isin(o.points, o.points[o.cameras == 7])
    kept = BundleObservations(o.cameras[~shared], o.points[~shared], o.pixels[~shared])
    left = solved(replace(problem, observations=kept), dropped=[7])[0].remaining
    assert left is not None
    H = np.array(left.prior.matrix)
    assert np.abs(H[18:24]).max() < 1e-9 * np.abs(H).max()
    sizes = np.tile(np.sqrt(np.diag(H).reshape(-1, 2, 3).max(axis=(0, 2))).repeat(3), 7)
    noise = 1e-16 * np.outer(sizes, sizes) * np.random.default_rng(0).normal(size=H.shape)
    left = replace(left, prior=replace(left.prior, information=(H + noise + noise.T).reshape(-1)))
    for dropped in (6, 5):
        found, dfn = solved(left, dropped=[dropped])
        assert dfn.metrics["gauge_directions"] == (6.0 if stereo else 7.0)
        left = found.remaining
        assert left is not None


def test_steps_that_tear_the_poses_from_the_prior_are_tried_and_left() -> None:
    whole, _ = solved(ring(10, 120, 5, 0.5, 1)[0])
    remaining = solved(whole.problem, dropped=[7, 8, 9], max_iterations=0)[0].remaining
    assert remaining is not None
    system, at = System.of(remaining, 0, NO_LOSS, 1.0), System.first(remaining)
    c = at.c.copy()
    c[0] = 1e12
    assert system.residuals(replace(at, c=c))[2] == np.inf
    T = remaining.cameras.matrices
    T[0, :3, 3] = 1e12
    torn = replace(remaining, cameras=replace(remaining.cameras, poses=pack_poses(T, "torn")))
    with pytest.raises(InputError, match="near"):
        solved(torn, dropped=[6], max_iterations=0)


def test_a_prior_of_which_nothing_was_fixed_does_not_mind_where_everything_is_and_how_large() -> None:
    whole, _ = solved(ring(10, 120, 5, 0.5, 1)[0])
    remaining = solved(whole.problem, dropped=[7, 8, 9], max_iterations=0)[0].remaining
    assert remaining is not None
    T, X, turned = remaining.cameras.matrices, remaining.points.positions, se3.exp_so3([0.3, -0.5, 0.4])
    T[:, :3, 3] = 1.3 * T[:, :3, 3] @ turned.T + [5.0, -70.0, 9.0]
    T[:, :3, :3] = turned @ T[:, :3, :3]
    elsewhere = replace(
        remaining, cameras=replace(remaining.cameras, poses=pack_poses(T, "moved")),
        points=replace(remaining.points, positions=1.3 * X @ turned.T + [5.0, -70.0, 9.0]),
    )  # fmt: skip
    here, there = (System.of(problem, 0, NO_LOSS, 1.0) for problem in (remaining, elsewhere))
    at = System.first(elsewhere)
    assert there.residuals(at)[2] == pytest.approx(here.residuals(System.first(remaining))[2], rel=1e-9)
    rng, h = np.random.default_rng(1), 1e-6
    at = there.moved(at, 1e-4 * rng.normal(size=there.size), np.zeros_like(at.X))
    normal = there.normal(at, *there.residuals(at)[:2])
    for _ in range(3):
        d, dp = rng.normal(size=there.size), rng.normal(size=at.X.shape)
        costs = [there.residuals(there.moved(at, s * h * d, s * h * dp))[2] for s in (1.0, -1.0)]
        slope = float(normal.g @ d + (normal.gp * dp).sum())
        assert (costs[0] - costs[1]) / (2.0 * h) == pytest.approx(slope, rel=1e-3)


def test_the_variance_of_unit_weight_counts_what_the_prior_says() -> None:
    variances = []
    for seed in range(6):
        problem, *_ = ring(10, 120, 5, 0.5, seed)
        whole, _ = solved(problem)
        remaining = solved(whole.problem, dropped=[7, 8, 9], max_iterations=0)[0].remaining
        assert remaining is not None
        variances.append(solved(remaining)[1].metrics["unit_variance"])
    assert np.mean(variances) == pytest.approx(0.25, rel=0.15)


def test_fewer_residuals_than_unknowns_and_bad_numbers_are_said() -> None:
    T = np.stack([np.eye(4), se3.transform(np.eye(3), [1.0, 0, 0])])
    few = BundleProblem.from_arrays(
        T, [700.0, 700, 0, 0], [[0.0, 0, 5], [1, 0, 5]], ([0, 1, 0, 1], [0, 0, 1, 1]), np.zeros((4, 2)), frame="site"
    )
    found, dfn = solved(few)
    assert "underdetermined" in dfn.reasons
    assert np.isnan(found.pose_covariances).any()
    pixels = np.full((4, 2), np.nan)
    o = few.observations
    bad = BundleProblem.from_arrays(T, [700.0] * 4, np.ones((2, 3)), (o.cameras, o.points), pixels, frame="site")
    with pytest.raises(InputError, match="finite"):
        solved(bad)
    with pytest.raises(InputError, match="dropped"):
        solved(few, dropped=[99])


def test_what_holds_a_problem_is_found_without_a_matrix_square_in_the_points(rng: np.random.Generator) -> None:
    rows = np.zeros((6000, 7))
    rows[:, :3] = rng.normal(size=(6000, 3))
    tracemalloc.start()
    try:
        free = unheld(rows)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert free.shape == (4, 7)
    assert np.abs(free[:, :3]).max() < 1e-9
    assert peak < 10 * rows.nbytes

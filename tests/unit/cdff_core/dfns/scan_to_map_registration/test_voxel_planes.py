# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_core.dfns.scan_to_map_registration.interface import ScanToMapRegistrationInputs as Inputs
from cdff_core.dfns.scan_to_map_registration.voxel_planes import VoxelPlanes
from tests.support.hills import Float, Ground, flat_ground, hills, pose_on_ground, sweep_points

PRIOR = np.diag([0.1**2] * 3 + [0.05**2] * 3)
SWEEP_PRIOR = np.diag([0.03**2] * 3 + [0.012**2] * 3)


def make_node(**config: float) -> VoxelPlanes:
    node = VoxelPlanes()
    node.configure({"radius_m": 30.0, **config})
    return node


def make_node_with_map(ground: Ground, rng: np.random.Generator, **config: float) -> VoxelPlanes:
    """Return a node with a map of the ground from five poses around the origin."""
    node = make_node(**config)
    for x, y in ((0, 0), (0.7, 0.1), (-0.6, 0.3), (0.2, 0.8), (-0.2, -0.7)):
        T = pose_on_ground(ground, x, y, 0.0)
        points, _ = sweep_points(ground, T, T, rng)
        node.process(Inputs(new_map_points=se3.transform_points(T, points), guess=T))
    return node


@pytest.fixture
def ground() -> Ground:
    return hills()


def test_pose_and_motion_during_the_sweep_are_estimated_jointly(
    ground: Ground, rng: np.random.Generator
) -> None:
    node = make_node_with_map(ground, rng)
    T_start, T_end = pose_on_ground(ground, 0.2, 0.1, 0.0), pose_on_ground(ground, 0.3, 0.1, 0.02)
    points, fraction = sweep_points(ground, T_start, T_end, rng)
    T_end_start = se3.inverse(T_end) @ T_start
    guess_error = se3.exp_se3([0.03, -0.02, 0.01, 0.004, -0.006, 0.008])
    outputs = node.process(
        Inputs(
            points=points,
            point_times=fraction,
            guess=T_end @ se3.exp_se3([0.08, -0.06, 0.03, 0.01, -0.02, 0.03]),
            sweep_guess=T_end_start @ guess_error,
            guess_covariance=PRIOR,
            sweep_covariance=SWEEP_PRIOR,
        )
    )
    error = se3.log_se3(se3.inverse(T_end) @ outputs.transform)
    assert np.linalg.norm(error[:3]) < 0.025
    assert np.degrees(np.linalg.norm(error[3:])) < 0.15
    motion_error = se3.log_se3(se3.inverse(T_end_start) @ outputs.sweep)
    assert np.linalg.norm(motion_error[3:]) < 0.5 * np.linalg.norm(se3.log_se3(guess_error)[3:])
    assert outputs.converged
    assert outputs.inlier_ratio > 0.4
    assert np.all(outputs.sigma_m < 0.045)
    assert np.all(np.linalg.eigvalsh(outputs.covariance) > 0.0)


def test_the_number_of_iterations_is_limited(ground: Ground, rng: np.random.Generator) -> None:
    node = make_node_with_map(ground, rng, max_iterations=2)
    T = pose_on_ground(ground, 0.2, 0.1, 0.0)
    points, fraction = sweep_points(ground, T, T, rng)
    guess = T @ se3.exp_se3([0.08, -0.06, 0.03, 0.01, -0.02, 0.03])
    outputs = node.process(Inputs(points=points, point_times=fraction, guess=guess, guess_covariance=PRIOR))
    assert outputs.iterations == 2
    assert not outputs.converged


def test_deceleration_does_not_distort_the_sweep_if_the_previous_pose_is_known(
    ground: Ground, rng: np.random.Generator
) -> None:
    node = make_node_with_map(ground, rng)
    T_previous, T_start, T_end = (pose_on_ground(ground, x, 0.1, 0.0) for x in (0.1, 0.28, 0.3))
    points, fraction = sweep_points(ground, T_start, T_end, rng)
    # Motion of 0.1 s at the previous speed of 1 m/s.
    too_fast = se3.transform(np.eye(3), np.array([-0.1, 0.0, 0.0]))
    sweep = {"points": points, "point_times": fraction, "guess": T_end, "sweep_guess": too_fast}
    prior = {"guess_covariance": 4.0 * PRIOR, "sweep_covariance": 0.1 * SWEEP_PRIOR}
    without_previous = node.process(Inputs(**sweep, **prior))
    with_previous = node.process(Inputs(**sweep, **prior, previous_pose=T_previous, sweep_fraction=0.1))
    errors_m = [
        np.linalg.norm(outputs.transform[:3, 3] - T_end[:3, 3])
        for outputs in (without_previous, with_previous)
    ]
    assert errors_m[1] < 0.02
    assert errors_m[1] < 0.6 * errors_m[0]


def test_a_sweep_longer_than_its_period_is_refused(ground: Ground, rng: np.random.Generator) -> None:
    node, T = make_node_with_map(ground, rng), pose_on_ground(ground, 0.1, 0.1, 0.0)
    points, fraction = sweep_points(ground, T, T, rng)
    with pytest.raises(InputError, match="sweep_fraction 2"):
        node.process(
            Inputs(points=points, point_times=fraction, guess=T, previous_pose=T, sweep_fraction=2.0)
        )


def test_on_flat_ground_the_guess_determines_the_degenerate_directions(rng: np.random.Generator) -> None:
    node = make_node_with_map(flat_ground, rng)
    T = pose_on_ground(flat_ground, 0.4, 0.0, 0.0)
    points, fraction = sweep_points(flat_ground, T, T, rng)
    guess = T @ se3.exp_se3([0.1, 0.05, 0.04, 0.01, -0.01, 0.03])
    outputs = node.process(
        Inputs(
            points=points,
            point_times=fraction,
            guess=guess,
            guess_covariance=PRIOR,
            sweep_covariance=SWEEP_PRIOR,
        )
    )
    unconstrained = outputs.directions[outputs.sigma_m > 0.045]
    assert len(unconstrained) == 3
    horizontal = np.abs(unconstrained) @ np.array([1, 1, 0, 0, 0, 1.0])
    assert np.all(horizontal > 0.9)  # translation in x and y, rotation about z
    error = se3.log_se3(se3.inverse(T) @ outputs.transform)
    assert abs(error[2]) < 0.01
    np.testing.assert_allclose(error[:2], [0.1, 0.05], atol=0.02)
    sigma = np.sqrt(np.diag(outputs.covariance))
    assert sigma[2] < 0.02
    np.testing.assert_allclose(sigma[[0, 1, 5]], [0.1, 0.1, 0.05], rtol=0.2)


def test_noisy_distant_planes_do_not_outweigh_near_ground_in_rotation(
    rng: np.random.Generator,
) -> None:
    full_relief, rings_m = hills(), np.geomspace(2.0, 55.0, 64)

    def ground(x: Float, y: Float) -> Float:
        return np.asarray(0.7 * full_relief(x, y))

    T = pose_on_ground(ground, 0.0, 0.0, 0.0)
    nodes = [make_node(radius_m=60.0, **config) for config in ({"known_count": 6}, {})]
    for _ in range(3):  # a map of few sweeps
        surface, _ = sweep_points(ground, T, T, rng, 0.01, rings_m)
        for node in nodes:
            node.process(Inputs(new_map_points=se3.transform_points(T, surface), guess=T))
    points, fraction = sweep_points(ground, T, T, rng, 0.01, rings_m)
    all_planes, reliable_planes = (
        node.process(Inputs(points=points, point_times=fraction, guess=T)) for node in nodes
    )
    assert all_planes.agreement.min() < 0.8 * reliable_planes.agreement.min()
    assert reliable_planes.agreement.min() > 0.5
    assert np.all(reliable_planes.sigma_m < 0.09)  # every direction is constrained


def test_a_sweep_outside_the_map_is_refused(ground: Ground, rng: np.random.Generator) -> None:
    node = make_node_with_map(ground, rng)
    T = pose_on_ground(ground, 200.0, 0.0, 0.0)
    points, fraction = sweep_points(ground, T, T, rng)
    with pytest.raises(RefusedError) as raised:
        node.process(Inputs(points=points, point_times=fraction, guess=T))
    assert raised.value.reasons == ("no_overlap",)


@pytest.mark.slow
def test_distant_points_are_evicted_so_that_memory_does_not_grow_with_the_path_length(
    ground: Ground, rng: np.random.Generator
) -> None:
    node, map_bytes = make_node(radius_m=15.0), []
    for x in range(0, 240, 2):
        T = pose_on_ground(ground, float(x), 0.0, 0.0)
        points, _ = sweep_points(ground, T, T, rng)
        node.process(Inputs(new_map_points=se3.transform_points(T, points), guess=T))
        map_bytes.append(node.map_bytes)
    assert max(map_bytes[60:]) == max(map_bytes[:60])
    assert node.voxels < 0.6 * len(node._map.tables[0].keys)


def test_non_finite_points_are_refused(ground: Ground, rng: np.random.Generator) -> None:
    node = make_node_with_map(ground, rng)
    T = pose_on_ground(ground, 0.1, 0.1, 0.0)
    points, fraction = sweep_points(ground, T, T, rng)
    points[::7] = np.nan
    with pytest.raises(InputError, match="points"):
        node.process(Inputs(points=points, point_times=fraction, guess=T))


def test_two_runs_on_the_same_input_are_equal_bit_for_bit(ground: Ground) -> None:
    def run() -> bytes:
        rng = np.random.default_rng(5)
        node = make_node_with_map(ground, rng)
        T = pose_on_ground(ground, 0.3, 0.0, 0.0)
        points, fraction = sweep_points(ground, T, T, rng)
        return bytes(node.process(Inputs(points=points, point_times=fraction, guess=T)).transform.tobytes())

    assert run() == run()


def test_a_malformed_array_is_refused_with_its_name() -> None:
    node = make_node()
    with pytest.raises(InputError, match="point_times"):
        node.process(Inputs(points=np.ones((5, 3)), point_times=np.zeros(4)))
    with pytest.raises(InputError, match="guess_covariance"):
        node.process(Inputs(points=np.ones((5, 3)), guess_covariance=np.eye(3)))
    with pytest.raises(InputError, match="guess"):
        node.process(Inputs(points=np.ones((5, 3)), guess=np.zeros((4, 4))))


def test_without_points_the_guess_is_returned(rng: np.random.Generator) -> None:
    T = se3.exp_se3(rng.normal(0, 0.3, 6))
    outputs = make_node().process(Inputs(guess=T))
    np.testing.assert_array_equal(outputs.transform, T)
    assert not outputs.converged


def urban_points(T: Float, rings: int, rng: np.random.Generator) -> Float:
    """Return the points of a spinning lidar 1.8 m above a courtyard with walls and pillars, in its frame.

    The walls have different distances, and the pillars break the symmetry.
    """
    azimuth = rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(900) / 900
    elevation = np.radians(np.linspace(-15.0, 15.0, rings))
    a, e = (g.ravel() for g in np.meshgrid(azimuth, elevation))
    rays = np.column_stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]) @ T[:3, :3].T
    origin = T[:3, 3]
    normals = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0.2, -1, 0], [0, 0, -1]], dtype=float)
    offsets_m = np.array([14.0, 9.0, 11.0, 7.0, 1.8])
    cosine = rays @ normals.T
    with np.errstate(divide="ignore"):
        range_m = np.where(cosine > 1e-6, (offsets_m - normals @ origin) / cosine, np.inf)
    for x, y in ((5.0, 4.0), (-4.0, 6.0), (6.0, -3.0)):  # pillars with four sides
        for normal in ([1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0], [0, -1.0, 0]):
            n = np.array(normal)
            with np.errstate(divide="ignore", invalid="ignore"):
                t = ((np.array([x, y, 0.0]) - 0.8 * n - origin) @ n) / (rays @ n)
            hit = origin + t[:, None] * rays
            is_on = (np.abs(hit[:, 0] - x) <= 0.8) & (np.abs(hit[:, 1] - y) <= 0.8) & (t > 0.5)
            range_m = np.column_stack([range_m, np.where(is_on, t, np.inf)])
    distance_m = range_m.min(axis=1) + rng.normal(0, 0.01, len(rays))
    is_near = distance_m < 50.0
    return np.asarray((distance_m[:, None] * rays)[is_near] @ T[:3, :3])


def urban_node(rng: np.random.Generator) -> VoxelPlanes:
    """Return a node with a map of one sweep of 16 rings in the courtyard."""
    node = make_node(radius_m=60.0)
    node.process(Inputs(new_map_points=urban_points(np.eye(4), 16, rng)))
    return node


def test_one_sweep_of_16_rings_constrains_a_motion_of_more_than_a_voxel(rng: np.random.Generator) -> None:
    node = urban_node(rng)
    T = se3.transform(se3.exp_so3(np.array([0.0, 0.0, 0.03])), np.array([1.1, 0.2, 0.0]))
    outputs = node.process(Inputs(points=urban_points(T, 16, rng), guess_covariance=100.0 * PRIOR))
    error = se3.log_se3(se3.inverse(T) @ outputs.transform)
    assert outputs.converged
    assert np.linalg.norm(error[:3]) < 0.04
    assert np.degrees(np.linalg.norm(error[3:])) < 0.3
    assert np.all(outputs.sigma_m < 0.09)


def test_the_best_of_several_candidates_is_registered(rng: np.random.Generator) -> None:
    node = urban_node(rng)
    T = se3.transform(se3.exp_so3(np.array([0.0, 0.0, 0.87])), np.array([0.3, 0.1, 0.0]))
    points = urban_points(T, 16, rng)
    yaw = np.radians(np.arange(10.0, 360.0, 10.0))[:, None] * np.array([0.0, 0.0, 1.0])
    candidates = np.tile(np.eye(4), (len(yaw), 1, 1))
    candidates[:, :3, :3] = se3.exp_so3(yaw)
    alone = node.process(Inputs(points=points, guess_covariance=PRIOR))
    outputs = node.process(
        Inputs(points=points, guess_covariance=100.0 * PRIOR, alternative_guesses=candidates)
    )
    assert np.linalg.norm(se3.log_se3(se3.inverse(T) @ alone.transform)) > 0.5
    assert np.linalg.norm(se3.log_se3(se3.inverse(T) @ outputs.transform)) < 0.05
    assert outputs.support_ratio > 1.15 * alone.support_ratio


def test_the_calibration_covariance_covers_the_effect_of_range_errors_of_the_rings(
    ground: Ground, rng: np.random.Generator
) -> None:
    sigma_m = 0.02
    node = make_node_with_map(
        ground, rng, range_sigma_m=0.0, ring_range_sigma_m=sigma_m, ring_elevation_sigma_deg=0.0
    )
    T = pose_on_ground(ground, 0.1, 0.1, 0.0)
    points, fraction = sweep_points(ground, T, T, rng)
    exact = node.process(Inputs(points=points, point_times=fraction, guess=T))
    elevation = np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))
    ring = np.floor((elevation / np.pi + 0.5) * 720).astype(int)
    squared = []
    for _ in range(12):
        error_m = rng.normal(0.0, sigma_m, 720)[ring]
        moved = points * (1.0 + error_m / np.linalg.norm(points, axis=1))[:, None]
        outputs = node.process(Inputs(points=moved, point_times=fraction, guess=T))
        shift_m = outputs.transform[:3, 3] - exact.transform[:3, 3]
        squared.append(shift_m @ np.linalg.solve(exact.calibration_covariance[:3, :3], shift_m))
    assert 1.0 < np.mean(squared) < 9.0  # 3 expected


def test_points_that_pull_against_each_other_increase_the_covariance_by_residuals(
    ground: Ground, rng: np.random.Generator
) -> None:
    node = make_node_with_map(ground, rng)
    T = pose_on_ground(ground, 0.1, 0.1, 0.0)
    points, fraction = sweep_points(ground, T, T, rng)
    raised = points + np.where(points[:, :1] > 0.0, 0.06, -0.06) * np.array([0.0, 0.0, 1.0])
    consistent, contradicting = (
        node.process(Inputs(points=p, point_times=fraction, guess=T, guess_covariance=1e-4 * PRIOR))
        for p in (points, raised)
    )
    ratio = np.trace(contradicting.residual_covariance[:3, :3]) / np.trace(
        consistent.residual_covariance[:3, :3]
    )
    assert ratio > 2.0

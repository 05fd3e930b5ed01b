# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_core.dfns.scan_to_map_registration._interface import ScanToMapRegistrationInputs as Inputs
from cdff_core.dfns.scan_to_map_registration.voxel_planes import VoxelPlanes
from tests.hills import Float, Ground, hills, plain, standing, sweep_points

PRIOR = np.diag([0.1**2] * 3 + [0.05**2] * 3)
SWEEP_PRIOR = np.diag([0.03**2] * 3 + [0.012**2] * 3)


def made(**config: float) -> VoxelPlanes:
    node = VoxelPlanes()
    node.configure({"radius_m": 30.0, **config})
    return node


def mapped(ground: Ground, rng: np.random.Generator, **config: float) -> VoxelPlanes:
    """A node that has seen the ground from five places around the origin."""
    node = made(**config)
    for x, y in ((0, 0), (0.7, 0.1), (-0.6, 0.3), (0.2, 0.8), (-0.2, -0.7)):
        T = standing(ground, x, y, 0.0)
        points, _ = sweep_points(ground, T, T, rng)
        node.process(Inputs(surface=se3.transform_points(T, points), guess=T))
    return node


@pytest.fixture
def ground() -> Ground:
    return hills()


def test_pose_and_motion_during_the_sweep_are_found_together(ground: Ground, rng: np.random.Generator) -> None:
    node = mapped(ground, rng)
    T_begin, T_end = standing(ground, 0.2, 0.1, 0.0), standing(ground, 0.3, 0.1, 0.02)
    points, fraction = sweep_points(ground, T_begin, T_end, rng)
    moved = se3.inverse(T_end) @ T_begin
    off = se3.exp_se3([0.03, -0.02, 0.01, 0.004, -0.006, 0.008])
    found = node.process(
        Inputs(
            points=points,
            fraction=fraction,
            guess=T_end @ se3.exp_se3([0.08, -0.06, 0.03, 0.01, -0.02, 0.03]),
            sweep_guess=moved @ off,
            guess_covariance=PRIOR,
            sweep_covariance=SWEEP_PRIOR,
        )
    )
    error = se3.log_se3(se3.inverse(T_end) @ found.transform)
    assert np.linalg.norm(error[:3]) < 0.025
    assert np.degrees(np.linalg.norm(error[3:])) < 0.15
    left = se3.log_se3(se3.inverse(moved) @ found.sweep)
    assert np.linalg.norm(left[3:]) < 0.5 * np.linalg.norm(se3.log_se3(off)[3:])
    assert found.converged
    assert found.inlier_ratio > 0.4
    assert np.all(found.sigma_m < 0.045)
    assert np.all(np.linalg.eigvalsh(found.covariance) > 0.0)


def test_slowing_down_does_not_skew_the_sweep_where_the_pose_before_is_known(
    ground: Ground, rng: np.random.Generator
) -> None:
    node = mapped(ground, rng)
    T_before, T_begin, T_end = (standing(ground, x, 0.1, 0.0) for x in (0.1, 0.28, 0.3))
    points, fraction = sweep_points(ground, T_begin, T_end, rng)
    too_fast = se3.transform(np.eye(3), np.array([-0.1, 0.0, 0.0]))  # as if it moved on at 1 m/s for 0.1 s
    sweep = {"points": points, "fraction": fraction, "guess": T_end, "sweep_guess": too_fast}
    prior = {"guess_covariance": 4.0 * PRIOR, "sweep_covariance": 0.1 * SWEEP_PRIOR}
    alone = node.process(Inputs(**sweep, **prior))
    known = node.process(Inputs(**sweep, **prior, before=T_before, sweep_share=np.array(0.1)))
    off_m = [np.linalg.norm(f.transform[:3, 3] - T_end[:3, 3]) for f in (alone, known)]
    assert off_m[1] < 0.02
    assert off_m[1] < 0.6 * off_m[0]


def test_a_sweep_longer_than_its_period_is_refused(ground: Ground, rng: np.random.Generator) -> None:
    node, T = mapped(ground, rng), standing(ground, 0.1, 0.1, 0.0)
    points, fraction = sweep_points(ground, T, T, rng)
    with pytest.raises(InputError, match="sweep_share 2"):
        node.process(Inputs(points=points, fraction=fraction, guess=T, before=T, sweep_share=np.array(2.0)))


def test_on_a_plain_the_guess_holds_where_the_ground_says_nothing(rng: np.random.Generator) -> None:
    node = mapped(plain, rng)
    T = standing(plain, 0.4, 0.0, 0.0)
    points, fraction = sweep_points(plain, T, T, rng)
    guess = T @ se3.exp_se3([0.1, 0.05, 0.04, 0.01, -0.01, 0.03])
    found = node.process(
        Inputs(points=points, fraction=fraction, guess=guess, guess_covariance=PRIOR, sweep_covariance=SWEEP_PRIOR)
    )
    free = found.directions[found.sigma_m > 0.045]
    assert len(free) == 3
    along = np.abs(free) @ np.array([1, 1, 0, 0, 0, 1.0])
    assert np.all(along > 0.9)  # shift in x and y, turn about z
    error = se3.log_se3(se3.inverse(T) @ found.transform)
    assert abs(error[2]) < 0.01
    np.testing.assert_allclose(error[:2], [0.1, 0.05], atol=0.02)
    sigma = np.sqrt(np.diag(found.covariance))
    assert sigma[2] < 0.02
    np.testing.assert_allclose(sigma[[0, 1, 5]], [0.1, 0.1, 0.05], rtol=0.2)


def test_noise_of_far_planes_through_few_points_does_not_hide_what_near_ground_says_of_a_turn(
    rng: np.random.Generator,
) -> None:
    rolling, rings_m = hills(), np.geomspace(2.0, 55.0, 64)

    def ground(x: Float, y: Float) -> Float:
        return np.asarray(0.7 * rolling(x, y))

    T = standing(ground, 0.0, 0.0, 0.0)
    nodes = [made(radius_m=60.0, **config) for config in ({"known_count": 6}, {})]
    for _ in range(3):  # a young map
        surface, _ = sweep_points(ground, T, T, rng, 0.01, rings_m)
        for node in nodes:
            node.process(Inputs(surface=se3.transform_points(T, surface), guess=T))
    points, fraction = sweep_points(ground, T, T, rng, 0.01, rings_m)
    every, known = (node.process(Inputs(points=points, fraction=fraction, guess=T)) for node in nodes)
    assert every.agreement.min() < 0.25
    assert known.agreement.min() > 0.5
    assert np.all(known.sigma_m < 0.09)  # nothing is held back


def test_a_sweep_beside_the_map_is_refused(ground: Ground, rng: np.random.Generator) -> None:
    node = mapped(ground, rng)
    T = standing(ground, 200.0, 0.0, 0.0)
    points, fraction = sweep_points(ground, T, T, rng)
    with pytest.raises(RefusedError) as raised:
        node.process(Inputs(points=points, fraction=fraction, guess=T))
    assert raised.value.reasons == ("no_overlap",)


def test_what_is_far_is_forgotten_and_the_memory_is_that_of_the_surroundings(
    ground: Ground, rng: np.random.Generator
) -> None:
    node, held = made(radius_m=15.0), []
    for x in range(0, 240, 2):
        T = standing(ground, float(x), 0.0, 0.0)
        points, _ = sweep_points(ground, T, T, rng)
        node.process(Inputs(surface=se3.transform_points(T, points), guess=T))
        held.append(node.map_bytes)
    assert max(held[60:]) == max(held[:60])
    assert node.voxels < 0.6 * len(node._table.keys)


def test_points_that_are_not_finite_do_not_matter(ground: Ground, rng: np.random.Generator) -> None:
    node = mapped(ground, rng)
    T = standing(ground, 0.1, 0.1, 0.0)
    points, fraction = sweep_points(ground, T, T, rng)
    points[::7] = np.nan
    with pytest.raises(InputError, match="points"):
        node.process(Inputs(points=points, fraction=fraction, guess=T))


def test_two_runs_are_equal_to_the_last_bit(ground: Ground) -> None:
    def run() -> bytes:
        rng = np.random.default_rng(5)
        node = mapped(ground, rng)
        T = standing(ground, 0.3, 0.0, 0.0)
        points, fraction = sweep_points(ground, T, T, rng)
        return bytes(node.process(Inputs(points=points, fraction=fraction, guess=T)).transform.tobytes())

    assert run() == run()


def test_malformed_input_is_named() -> None:
    node = made()
    with pytest.raises(InputError, match="fraction"):
        node.process(Inputs(points=np.ones((5, 3)), fraction=np.zeros(4)))
    with pytest.raises(InputError, match="guess_covariance"):
        node.process(Inputs(points=np.ones((5, 3)), guess_covariance=np.eye(3)))
    with pytest.raises(InputError, match="guess"):
        node.process(Inputs(points=np.ones((5, 3)), guess=np.zeros((4, 4))))


def test_without_points_the_guess_comes_back(rng: np.random.Generator) -> None:
    T = se3.exp_se3(rng.normal(0, 0.3, 6))
    found = made().process(Inputs(guess=T))
    np.testing.assert_array_equal(found.transform, T)
    assert not found.converged

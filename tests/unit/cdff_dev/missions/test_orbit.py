# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The orbital model of a mission is the true terrain with blur and noise, in the site frame."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from cdff_dev.missions.orbital_map import simulate_orbital_model
from cdff_dev.missions.script import OrbitalModel
from cdff_dev.simulate.traverse import levelled
from cdff_dev.simulate.world import World

MODEL = OrbitalModel(resolution_m=1.0, half_width_m=6.0, noise_m=0.05)


def test_the_orbital_model_is_the_terrain_with_blur_and_noise(world: World) -> None:
    robot = next(iter(world.motions))
    T_site_odom = se3.transform(se3.exp_so3(np.array([0.0, 0.0, 0.4])), np.array([3.0, -2.0, 7.0]))
    model = simulate_orbital_model(world, robot, T_site_odom, MODEL)
    assert model.frame == "site"
    x, y = model.geometry.centres_m()
    T_world_site = levelled(world.motions[robot].poses(np.zeros(1))[0]) @ se3.inverse(T_site_odom)
    points_world = se3.transform_points(
        T_world_site, np.column_stack([x.ravel(), y.ravel(), model.layer("mean").ravel()])
    )
    errors_m = points_world[:, 2] - world.relief.height(points_world[:, :2])
    assert 0.02 < errors_m.std() < 0.15
    assert abs(errors_m.mean()) < 0.05
    np.testing.assert_allclose(model.layer("variance"), 0.05**2, rtol=1e-6)


def test_two_models_are_equal_and_less_noise_is_closer_to_the_terrain(world: World) -> None:
    robot = next(iter(world.motions))
    first, second = (simulate_orbital_model(world, robot, np.eye(4), MODEL).layer("mean") for _ in range(2))
    np.testing.assert_array_equal(first, second)
    less_noisy = simulate_orbital_model(
        world, robot, np.eye(4), MODEL.model_copy(update={"noise_m": 0.01})
    ).layer("mean")
    assert 0.0 < float(np.abs(first - less_noisy).max()) < 0.3

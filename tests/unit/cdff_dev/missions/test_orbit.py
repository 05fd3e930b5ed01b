# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What an orbiter saw before a mission: true but for blur and noise, in the site that the rover begins in."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry import se3
from cdff_dev.missions.orbit import seen_from_orbit
from cdff_dev.missions.script import FromOrbit
from cdff_dev.simulate.traverse import levelled
from cdff_dev.simulate.world import World

ASKED = FromOrbit(resolution_m=1.0, half_width_m=6.0, noise_m=0.05)


def test_the_model_is_the_ground_of_the_site_but_for_blur_and_noise(world: World) -> None:
    robot = next(iter(world.motions))
    T_site_odom = se3.transform(se3.exp_so3(np.array([0.0, 0.0, 0.4])), np.array([3.0, -2.0, 7.0]))
    model = seen_from_orbit(world, robot, T_site_odom, ASKED)
    assert model.frame == "site"
    x, y = model.geometry.centres_m()
    T_world_site = levelled(world.motions[robot].poses(np.zeros(1))[0]) @ se3.inverse(T_site_odom)
    at = se3.transform_points(T_world_site, np.column_stack([x.ravel(), y.ravel(), model.layer("mean").ravel()]))
    off = at[:, 2] - world.relief.height(at[:, :2])
    assert 0.02 < off.std() < 0.15
    assert abs(off.mean()) < 0.05
    np.testing.assert_allclose(model.layer("variance"), 0.05**2, rtol=1e-6)


def test_two_looks_are_equal_and_less_noise_is_nearer_the_ground(world: World) -> None:
    robot = next(iter(world.motions))
    once, again = (seen_from_orbit(world, robot, np.eye(4), ASKED).layer("mean") for _ in range(2))
    np.testing.assert_array_equal(once, again)
    quieter = seen_from_orbit(world, robot, np.eye(4), ASKED.model_copy(update={"noise_m": 0.01})).layer("mean")
    assert 0.0 < float(np.abs(once - quieter).max()) < 0.3

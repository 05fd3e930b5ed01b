# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion along a commanded path: it starts and ends at rest, stays on the path and keeps the speed limit."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_dev.missions.motion import motion_along_path, motion_at_rest
from cdff_dev.simulate.relief import Relief
from cdff_dev.simulate.rover_motion import Motion, settle
from cdff_dev.simulate.scenario import Chassis
from cdff_dev.simulate.world import World

Float = NDArray[np.float64]

SPEED_M_S, RAMP_S = 0.8, 1.5
PATHS = {
    "two corners": [[0, 0], [4, 0]],
    "a bend": [[0, 0], [4, 0], [6, 2]],
    "a right angle": [[0, 0], [4, 0], [4, 4]],
    "a short end": [[0, 0], [5, 0], [5, 0.5]],
    "a zigzag": [[0, 0], [2, 1], [4, -1], [6, 1], [8, -1]],
    "a repeated corner": [[0, 0], [2, 0], [2, 0], [4, 1]],
}


@pytest.fixture
def chassis(world: World) -> Chassis:
    return world.scenario.chassis


def motion_along(
    chassis: Chassis, smoothed_relief: Relief, path: Float, heading_rad: float
) -> tuple[Motion, Float]:
    """Return the motion along a path, and times from its start to its end."""
    motion, end_s = motion_along_path(path, heading_rad, SPEED_M_S, RAMP_S, chassis, smoothed_relief)
    return motion, np.arange(0.0, end_s, 0.01)


def wheel_centres(chassis: Chassis, motion: Motion, t_s: Float) -> Float:
    """Return the positions (n, 2) of the centre between the wheels, on the ground."""
    T = motion.poses(t_s)
    return T[:, :2, 3] - chassis.base_height_m * T[:, :2, 2]


def distances_from_path(points: Float, path: Float) -> Float:
    """Return the distances (n,) of points (n, 2) from a path of straight legs."""
    legs = [(a, b - a) for a, b in pairwise(path) if np.linalg.norm(b - a) > 0]
    nearest = [a + np.clip((points - a) @ d / (d @ d), 0.0, 1.0)[:, None] * d for a, d in legs]
    return np.min([np.linalg.norm(points - on_leg, axis=1) for on_leg in nearest], axis=0)


@pytest.mark.parametrize("name", PATHS)
def test_a_motion_starts_and_ends_at_rest_at_the_ends_of_the_path(
    chassis: Chassis, smoothed_relief: Relief, name: str
) -> None:
    path = np.array(PATHS[name], dtype=np.float64)
    motion, t_s = motion_along(chassis, smoothed_relief, path, 0.0)
    ends = np.array([0.0, t_s[-1]])
    assert wheel_centres(chassis, motion, ends) == pytest.approx(path[[0, -1]], abs=2e-3)
    assert motion.position(ends, 1) == pytest.approx(np.zeros((2, 3)), abs=1e-3)
    assert motion.body_rates(ends) == pytest.approx(np.zeros((2, 3)), abs=1e-3)


@pytest.mark.parametrize("name", PATHS)
def test_the_motion_stays_on_the_given_path_through_each_corner(
    chassis: Chassis, smoothed_relief: Relief, name: str
) -> None:
    path = np.array(PATHS[name], dtype=np.float64)
    motion, t_s = motion_along(chassis, smoothed_relief, path, 0.0)
    positions = wheel_centres(chassis, motion, t_s)
    assert distances_from_path(positions, path).max() < 0.07
    for corner in path:
        assert np.linalg.norm(positions - corner, axis=1).min() < 0.10


def test_a_gentle_corner_is_cut_by_less_than_five_centimetres(
    chassis: Chassis, smoothed_relief: Relief
) -> None:
    path = np.array(PATHS["a bend"], dtype=np.float64)
    motion, t_s = motion_along(chassis, smoothed_relief, path, 0.0)
    assert np.linalg.norm(wheel_centres(chassis, motion, t_s) - path[1], axis=1).min() < 0.05


@pytest.mark.parametrize("name", PATHS)
def test_the_speed_stays_below_the_limit_and_is_lower_in_bends(
    chassis: Chassis, smoothed_relief: Relief, name: str
) -> None:
    motion, t_s = motion_along(chassis, smoothed_relief, np.array(PATHS[name], dtype=np.float64), 0.0)
    speed = np.linalg.norm(motion.position(t_s, 1)[:, :2], axis=1)
    assert speed.max() < SPEED_M_S * 1.06  # on slopes the base, above the wheels, moves a little more
    assert speed.max() > SPEED_M_S * 0.9
    assert np.abs(motion.body_rates(t_s)[:, 2]).max() < 1.0


def test_the_rover_turns_in_place_before_driving(chassis: Chassis, smoothed_relief: Relief) -> None:
    motion, t_s = motion_along(
        chassis, smoothed_relief, np.array([[0.0, 0.0], [0.0, 3.0]]), math.radians(-60.0)
    )
    T = motion.poses(t_s)
    heading = np.unwrap(np.arctan2(T[:, 1, 0], T[:, 0, 0]))
    distance_m = np.linalg.norm(wheel_centres(chassis, motion, t_s), axis=1)
    assert heading[0] == pytest.approx(math.radians(-60.0), abs=0.01)
    assert heading[distance_m > 0.02] == pytest.approx(math.radians(90.0), abs=0.02)
    assert np.gradient(heading, t_s).max() < math.radians(20.5)
    assert distance_m[heading < math.radians(80.0)].max() < 5e-3


def test_the_rover_turns_in_the_shorter_direction(chassis: Chassis, smoothed_relief: Relief) -> None:
    motion, t_s = motion_along(
        chassis, smoothed_relief, np.array([[0.0, 0.0], [-3.0, -0.5]]), math.radians(170.0)
    )
    rotation_rad = np.sum(motion.body_rates(t_s)[:, 2]) * 0.01
    assert 0.0 < rotation_rad < math.radians(30.0)


def test_the_wheels_stay_on_the_ground(chassis: Chassis, smoothed_relief: Relief) -> None:
    motion, t_s = motion_along(
        chassis, smoothed_relief, np.array(PATHS["a right angle"], dtype=np.float64), 0.0
    )
    T = motion.poses(t_s)
    T_on_ground = settle(
        smoothed_relief, chassis, wheel_centres(chassis, motion, t_s), np.arctan2(T[:, 1, 0], T[:, 0, 0])
    )
    assert T[:, 2, 3] == pytest.approx(T_on_ground[:, 2, 3], abs=5e-3)
    assert T[:, :3, 2] == pytest.approx(T_on_ground[:, :3, 2], abs=0.02)
    assert np.ptp(T[:, 2, 3]) > 0.02


def test_a_rover_at_rest_does_not_move(world: World) -> None:
    T = world.motions["mana"].poses(np.zeros(1))[0]
    motion, t_s = motion_at_rest(T, 2.0), np.linspace(0.0, 2.0, 9)
    assert motion.poses(t_s) == pytest.approx(np.tile(T, (9, 1, 1)), abs=1e-12)
    assert np.abs(motion.acceleration(t_s)).max() == pytest.approx(0.0, abs=1e-9)
    assert np.abs(motion.body_rates(t_s)).max() == pytest.approx(0.0, abs=1e-9)

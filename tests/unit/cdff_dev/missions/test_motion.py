# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A told way is driven as it was told: from rest to rest, on its line, no faster than stated, on the ground."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_dev.missions.motion import along, standing
from cdff_dev.simulate.drive import Motion, settle
from cdff_dev.simulate.relief import Relief
from cdff_dev.simulate.scenario import Chassis
from cdff_dev.simulate.world import World

Float = NDArray[np.float64]

SPEED_M_S, RAMP_S = 0.8, 1.5
WAYS = {
    "two corners": [[0, 0], [4, 0]],
    "a bend": [[0, 0], [4, 0], [6, 2]],
    "a right angle": [[0, 0], [4, 0], [4, 4]],
    "a short end": [[0, 0], [5, 0], [5, 0.5]],
    "a zigzag": [[0, 0], [2, 1], [4, -1], [6, 1], [8, -1]],
    "a corner twice": [[0, 0], [2, 0], [2, 0], [4, 1]],
}


@pytest.fixture
def chassis(world: World) -> Chassis:
    return world.scenario.chassis


def motion_along(chassis: Chassis, felt: Relief, way: Float, heading_rad: float) -> tuple[Motion, Float]:
    """The motion, and times from its begin to its end."""
    motion, end_s = along(way, heading_rad, SPEED_M_S, RAMP_S, chassis, felt)
    return motion, np.arange(0.0, end_s, 0.01)


def places(chassis: Chassis, motion: Motion, t_s: Float) -> Float:
    """Middles of the wheels (n, 2)."""
    T = motion.poses(t_s)
    return T[:, :2, 3] - chassis.base_height_m * T[:, :2, 2]


def off_way(points: Float, way: Float) -> Float:
    """Distances (n,) from a line through corners."""
    legs = [(a, b - a) for a, b in pairwise(way) if np.linalg.norm(b - a) > 0]
    nearest = [a + np.clip((points - a) @ d / (d @ d), 0.0, 1.0)[:, None] * d for a, d in legs]
    return np.min([np.linalg.norm(points - at, axis=1) for at in nearest], axis=0)


@pytest.mark.parametrize("name", WAYS)
def test_it_begins_and_ends_at_rest_at_the_ends_of_the_way(chassis: Chassis, felt: Relief, name: str) -> None:
    way = np.array(WAYS[name], dtype=np.float64)
    motion, t_s = motion_along(chassis, felt, way, 0.0)
    ends = np.array([0.0, t_s[-1]])
    assert places(chassis, motion, ends) == pytest.approx(way[[0, -1]], abs=2e-3)
    assert motion.position(ends, 1) == pytest.approx(np.zeros((2, 3)), abs=1e-3)
    assert motion.body_rates(ends) == pytest.approx(np.zeros((2, 3)), abs=1e-3)


@pytest.mark.parametrize("name", WAYS)
def test_it_stays_on_the_told_way_and_passes_each_corner(chassis: Chassis, felt: Relief, name: str) -> None:
    way = np.array(WAYS[name], dtype=np.float64)
    motion, t_s = motion_along(chassis, felt, way, 0.0)
    at = places(chassis, motion, t_s)
    assert off_way(at, way).max() < 0.07
    for corner in way:
        assert np.linalg.norm(at - corner, axis=1).min() < 0.10


def test_it_cuts_a_gentle_corner_by_less_than_five_centimetres(chassis: Chassis, felt: Relief) -> None:
    way = np.array(WAYS["a bend"], dtype=np.float64)
    motion, t_s = motion_along(chassis, felt, way, 0.0)
    assert np.linalg.norm(places(chassis, motion, t_s) - way[1], axis=1).min() < 0.05


@pytest.mark.parametrize("name", WAYS)
def test_it_is_never_faster_than_stated_and_slows_down_in_bends(chassis: Chassis, felt: Relief, name: str) -> None:
    motion, t_s = motion_along(chassis, felt, np.array(WAYS[name], dtype=np.float64), 0.0)
    speed = np.linalg.norm(motion.position(t_s, 1)[:, :2], axis=1)
    assert speed.max() < SPEED_M_S * 1.06  # on slopes the base, above the wheels, moves a little more
    assert speed.max() > SPEED_M_S * 0.9
    assert np.abs(motion.body_rates(t_s)[:, 2]).max() < 1.0


def test_it_turns_on_the_spot_before_it_drives(chassis: Chassis, felt: Relief) -> None:
    motion, t_s = motion_along(chassis, felt, np.array([[0.0, 0.0], [0.0, 3.0]]), math.radians(-60.0))
    T = motion.poses(t_s)
    heading = np.unwrap(np.arctan2(T[:, 1, 0], T[:, 0, 0]))
    gone = np.linalg.norm(places(chassis, motion, t_s), axis=1)
    assert heading[0] == pytest.approx(math.radians(-60.0), abs=0.01)
    assert heading[gone > 0.02] == pytest.approx(math.radians(90.0), abs=0.02)
    assert np.gradient(heading, t_s).max() < math.radians(20.5)
    assert gone[heading < math.radians(80.0)].max() < 5e-3


def test_it_turns_the_shorter_way_round(chassis: Chassis, felt: Relief) -> None:
    motion, t_s = motion_along(chassis, felt, np.array([[0.0, 0.0], [-3.0, -0.5]]), math.radians(170.0))
    turned = np.sum(motion.body_rates(t_s)[:, 2]) * 0.01
    assert 0.0 < turned < math.radians(30.0)


def test_its_wheels_stay_on_the_ground(chassis: Chassis, felt: Relief) -> None:
    motion, t_s = motion_along(chassis, felt, np.array(WAYS["a right angle"], dtype=np.float64), 0.0)
    T = motion.poses(t_s)
    on = settle(felt, chassis, places(chassis, motion, t_s), np.arctan2(T[:, 1, 0], T[:, 0, 0]))
    assert T[:, 2, 3] == pytest.approx(on[:, 2, 3], abs=5e-3)
    assert T[:, :3, 2] == pytest.approx(on[:, :3, 2], abs=0.02)
    assert np.ptp(T[:, 2, 3]) > 0.02


def test_who_stands_does_not_move(world: World) -> None:
    T = world.motions["mana"].poses(np.zeros(1))[0]
    motion, t_s = standing(T, 2.0), np.linspace(0.0, 2.0, 9)
    assert motion.poses(t_s) == pytest.approx(np.tile(T, (9, 1, 1)), abs=1e-12)
    assert np.abs(motion.acceleration(t_s)).max() == pytest.approx(0.0, abs=1e-9)
    assert np.abs(motion.body_rates(t_s)).max() == pytest.approx(0.0, abs=1e-9)

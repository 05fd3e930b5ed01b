# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Guidance chooses legs on navigation maps: on free ground only, towards goals that may lie beyond it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.errors import RefusedError
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import NavigationMap
from cdff_dev.missions.guidance import Guidance, _until_it_turns_back
from cdff_dev.missions.motion import SHARPEST_RAD, sharpest_turn_rad

Float = NDArray[np.float64]

UNKNOWN, SAFE, CAUTION, HAZARD = 0, 1, 2, 3
CELL_M, HALF_M = 0.2, 6.0
HERE = np.array([0.05, 0.03])


def ground(*areas: tuple[float, float, float, float, int], fill: int = SAFE) -> NavigationMap:
    """Twelve metres of ground, with areas (xmin, xmax, ymin, ymax, class) on it; caution costs more."""
    n = round(2 * HALF_M / CELL_M)
    geometry = GridGeometry("site", CELL_M, -HALF_M, HALF_M, n, n)
    x, y = geometry.centres_m()
    classes = np.full((n, n), fill, dtype=np.uint8)
    for x0, x1, y0, y1, kind in areas:
        classes[(x > x0) & (x < x1) & (y > y0) & (y < y1)] = kind
    cost = np.choose(classes, [np.nan, 0.0, 0.5, 1.0]).astype(np.float32)
    flat = np.zeros((n, n), dtype=np.float32)
    layers = {"class": classes, "slope_deg": flat, "step_m": flat, "roughness_m": flat, "cost": cost}
    return NavigationMap.from_layers(geometry, layers, t0_ns=0, t1_ns=1000)


def crossed(known: NavigationMap, way: Float) -> set[int]:
    """Classes of all cells that a way leads over."""
    points = np.concatenate([np.linspace(a, b, 500) for a, b in pairwise(way)])
    row, col, inside = known.geometry.cells_of(points[:, 0], points[:, 1])
    assert inside.all()
    return set(known.layer("class")[row, col].tolist())


def length_m(way: Float) -> float:
    return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())


@pytest.mark.req("CDFF-DEV-072")
def test_on_free_ground_it_goes_straight_to_the_goal() -> None:
    goal = np.array([4.1, 2.1])
    way = Guidance(20.0).leg(ground(), HERE, goal)
    assert way[0] == pytest.approx(HERE)
    assert way[-1] == pytest.approx(goal, abs=CELL_M)
    assert len(way) == 2


@pytest.mark.req("CDFF-DEV-072")
@pytest.mark.parametrize("kind", [HAZARD, UNKNOWN])
def test_it_goes_around_what_may_not_be_driven(kind: int) -> None:
    known = ground((2.0, 2.6, -4.0, 3.0, kind))
    way = Guidance(50.0).leg(known, HERE, np.array([5.1, 0.1]))
    assert crossed(known, way) == {SAFE}
    assert way[-1] == pytest.approx([5.1, 0.1], abs=CELL_M)
    assert 7.0 < length_m(way) < 9.5
    assert len(way) < 9  # as few corners as need be


@pytest.mark.req("CDFF-DEV-072")
def test_among_scattered_hazards_no_leg_leads_over_one(rng: np.random.Generator) -> None:
    for _ in range(5):
        corners = rng.uniform(-5.5, 5.0, (40, 2))
        rocks = [(x, x + 0.5, y, y + 0.5, HAZARD) for x, y in corners if np.hypot(x + 0.25, y + 0.25) > 1.0]
        known = ground(*rocks, (-1.0, 1.0, 2.0, 3.0, UNKNOWN))
        for goal in rng.uniform(-30.0, 30.0, (4, 2)):
            way = Guidance(8.0).leg(known, HERE, goal)
            assert crossed(known, way) <= {SAFE, CAUTION}


def test_caution_is_avoided_where_that_is_cheaper_and_crossed_where_it_must_be() -> None:
    patch = ground((1.0, 4.0, -0.6, 0.6, CAUTION))
    assert crossed(patch, Guidance(50.0).leg(patch, HERE, np.array([5.1, 0.1]))) == {SAFE}
    belt = ground((2.0, 2.6, -HALF_M, HALF_M, CAUTION))
    assert crossed(belt, Guidance(50.0).leg(belt, HERE, np.array([5.1, 0.1]))) == {SAFE, CAUTION}


@pytest.mark.req("CDFF-DEV-072")
def test_a_goal_beyond_the_map_is_approached_as_far_as_is_known() -> None:
    known = ground((3.0, HALF_M, -HALF_M, HALF_M, UNKNOWN))
    way = Guidance(50.0).leg(known, HERE, np.array([40.0, 0.0]))
    assert crossed(known, way) == {SAFE}
    assert way[-1, 0] == pytest.approx(2.9, abs=CELL_M)
    assert abs(way[-1, 1]) < 0.5


def test_a_goal_on_a_hazard_is_approached() -> None:
    known = ground((3.0, 5.0, -1.0, 1.0, HAZARD))
    way = Guidance(50.0).leg(known, HERE, np.array([4.1, 0.1]))
    assert crossed(known, way) == {SAFE}
    assert np.linalg.norm(way[-1] - [4.1, 0.1]) < 1.5


def test_a_leg_is_cut_to_its_length_along_the_same_way() -> None:
    known, goal = ground((2.0, 2.6, -4.0, 3.0, HAZARD)), np.array([5.1, 0.1])
    whole, begin = Guidance(50.0).leg(known, HERE, goal), Guidance(2.5).leg(known, HERE, goal)
    assert length_m(begin) == pytest.approx(2.5)
    assert begin[:-1] == pytest.approx(whole[: len(begin) - 1])


@pytest.mark.req("CDFF-DEV-072")
def test_walled_in_it_refuses() -> None:
    moat = [
        (-1.0, 1.0, 0.6, 1.0, HAZARD), (-1.0, 1.0, -1.0, -0.6, HAZARD),
        (-1.0, -0.6, -1.0, 1.0, HAZARD), (0.6, 1.0, -1.0, 1.0, UNKNOWN),
    ]  # fmt: skip
    with pytest.raises(RefusedError, match="no way on") as refused:
        Guidance(5.0).leg(ground(*moat), np.array([0.5, 0.05]), np.array([5.0, 0.0]))
    assert refused.value.reasons == ("no_way",)


def test_without_free_ground_near_it_refuses() -> None:
    with pytest.raises(RefusedError, match="no free ground") as refused:
        Guidance(5.0).leg(ground((-2.0, 2.0, -2.0, 2.0, UNKNOWN)), HERE, np.array([5.0, 0.0]))
    assert refused.value.reasons == ("no_way",)


def test_off_a_spot_it_may_not_stand_on_it_steps_to_the_nearest_that_it_may() -> None:
    known = ground((-0.6, 0.6, -0.6, 0.6, UNKNOWN))
    way = Guidance(50.0).leg(known, HERE, np.array([5.1, 0.1]))
    assert way[0] == pytest.approx(HERE)
    assert np.linalg.norm(way[1] - HERE) < 1.0
    assert crossed(known, way[1:]) == {SAFE}


def test_a_leg_ends_where_the_way_turns_back_so_that_the_rover_turns_on_the_spot_there() -> None:
    back = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.5], [0.5, 1.0], [0.0, 3.0]])
    assert sharpest_turn_rad(back) > SHARPEST_RAD
    assert _until_it_turns_back(back).tolist() == back[:3].tolist()
    gentle = back[[0, 1, 2, 4]]
    assert sharpest_turn_rad(gentle) < SHARPEST_RAD
    assert _until_it_turns_back(gentle).tolist() == gentle.tolist()


def test_it_does_not_begin_by_going_back_to_the_middle_of_its_own_cell() -> None:
    at = np.array([0.19, 0.1])
    way = Guidance(50.0).leg(ground(), at, np.array([5.1, 0.1]))
    assert way[0] == pytest.approx(at)
    assert np.diff(way[:, 0]).min() > 0.0


@pytest.mark.req("CDFF-DEV-072")
def test_in_a_dead_end_it_does_not_go_back_and_forth_but_finds_the_way_out() -> None:
    # A pocket that is open to the west only: a wall to the east, longer than the map shows, and its two arms.
    known = ground((3.0, 3.4, -HALF_M, HALF_M, HAZARD), (0.6, 3.4, 1.6, 2.0, HAZARD))
    guidance, at, ends = Guidance(7.0), HERE, []
    for _ in range(6):
        at = guidance.leg(known, at, np.array([30.0, 3.0]))[-1]
        ends.append(at)
    apart = [np.linalg.norm(a - b) for i, a in enumerate(ends) for b in ends[:i]]
    assert min(apart) > 1.0
    assert np.ptp(np.array(ends), axis=0).max() > 4.0

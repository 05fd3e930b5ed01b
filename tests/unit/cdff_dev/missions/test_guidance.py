# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Guidance plans legs on navigation maps: on free ground only, towards goals that may be outside the map."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.errors import RefusedError
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import NavigationMap
from cdff_dev.missions.guidance import Guidance, _up_to_sharp_turn
from cdff_dev.missions.motion import MAX_CORNER_RAD, sharpest_turn_rad

Float = NDArray[np.float64]

UNKNOWN, SAFE, CAUTION, HAZARD = 0, 1, 2, 3
CELL_M, HALF_M = 0.2, 6.0
START_XY = np.array([0.05, 0.03])


def ground(*areas: tuple[float, float, float, float, int], fill: int = SAFE) -> NavigationMap:
    """Return a map of 12 m with areas ``(xmin, xmax, ymin, ymax, class)``.

    The other cells have class ``fill``.
    """
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


def crossed_classes(navigation_map: NavigationMap, path: Float) -> set[int]:
    """Return the classes of all cells that a path crosses."""
    points = np.concatenate([np.linspace(a, b, 500) for a, b in pairwise(path)])
    row, col, inside = navigation_map.geometry.cells_of(points[:, 0], points[:, 1])
    assert inside.all()
    return set(navigation_map.layer("class")[row, col].tolist())


def length_m(path: Float) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


@pytest.mark.req("CDFF-DEV-072")
def test_free_ground_gives_a_straight_path() -> None:
    goal = np.array([4.1, 2.1])
    path = Guidance(20.0).leg(ground(), START_XY, goal)
    assert path[0] == pytest.approx(START_XY)
    assert path[-1] == pytest.approx(goal, abs=CELL_M)
    assert len(path) == 2


@pytest.mark.req("CDFF-DEV-072")
@pytest.mark.parametrize("kind", [HAZARD, UNKNOWN])
def test_forbidden_areas_are_bypassed(kind: int) -> None:
    navigation_map = ground((2.0, 2.6, -4.0, 3.0, kind))
    path = Guidance(50.0).leg(navigation_map, START_XY, np.array([5.1, 0.1]))
    assert crossed_classes(navigation_map, path) == {SAFE}
    assert path[-1] == pytest.approx([5.1, 0.1], abs=CELL_M)
    assert 7.0 < length_m(path) < 9.5
    assert len(path) < 9  # no unnecessary corners


@pytest.mark.req("CDFF-DEV-072")
def test_among_scattered_hazards_no_leg_crosses_one(rng: np.random.Generator) -> None:
    for _ in range(5):
        corners = rng.uniform(-5.5, 5.0, (40, 2))
        rocks = [(x, x + 0.5, y, y + 0.5, HAZARD) for x, y in corners if np.hypot(x + 0.25, y + 0.25) > 1.0]
        navigation_map = ground(*rocks, (-1.0, 1.0, 2.0, 3.0, UNKNOWN))
        for goal in rng.uniform(-30.0, 30.0, (4, 2)):
            path = Guidance(8.0).leg(navigation_map, START_XY, goal)
            assert crossed_classes(navigation_map, path) <= {SAFE, CAUTION}


def test_caution_areas_are_avoided_if_cheaper_and_crossed_if_necessary() -> None:
    patch = ground((1.0, 4.0, -0.6, 0.6, CAUTION))
    assert crossed_classes(patch, Guidance(50.0).leg(patch, START_XY, np.array([5.1, 0.1]))) == {SAFE}
    belt = ground((2.0, 2.6, -HALF_M, HALF_M, CAUTION))
    assert crossed_classes(belt, Guidance(50.0).leg(belt, START_XY, np.array([5.1, 0.1]))) == {SAFE, CAUTION}


@pytest.mark.req("CDFF-DEV-072")
def test_a_goal_outside_the_map_is_approached_to_the_edge_of_known_ground() -> None:
    navigation_map = ground((3.0, HALF_M, -HALF_M, HALF_M, UNKNOWN))
    path = Guidance(50.0).leg(navigation_map, START_XY, np.array([40.0, 0.0]))
    assert crossed_classes(navigation_map, path) == {SAFE}
    assert path[-1, 0] == pytest.approx(2.9, abs=CELL_M)
    assert abs(path[-1, 1]) < 0.5


def test_a_goal_on_a_hazard_is_approached() -> None:
    navigation_map = ground((3.0, 5.0, -1.0, 1.0, HAZARD))
    path = Guidance(50.0).leg(navigation_map, START_XY, np.array([4.1, 0.1]))
    assert crossed_classes(navigation_map, path) == {SAFE}
    assert np.linalg.norm(path[-1] - [4.1, 0.1]) < 1.5


def test_a_leg_is_shortened_along_the_same_path() -> None:
    navigation_map, goal = ground((2.0, 2.6, -4.0, 3.0, HAZARD)), np.array([5.1, 0.1])
    full_leg = Guidance(50.0).leg(navigation_map, START_XY, goal)
    short_leg = Guidance(2.5).leg(navigation_map, START_XY, goal)
    assert length_m(short_leg) == pytest.approx(2.5)
    assert short_leg[:-1] == pytest.approx(full_leg[: len(short_leg) - 1])


@pytest.mark.req("CDFF-DEV-072")
def test_an_enclosed_start_is_refused() -> None:
    moat = [
        (-1.0, 1.0, 0.6, 1.0, HAZARD),
        (-1.0, 1.0, -1.0, -0.6, HAZARD),
        (-1.0, -0.6, -1.0, 1.0, HAZARD),
        (0.6, 1.0, -1.0, 1.0, UNKNOWN),
    ]
    with pytest.raises(RefusedError, match="no further path") as refused:
        Guidance(5.0).leg(ground(*moat), np.array([0.5, 0.05]), np.array([5.0, 0.0]))
    assert refused.value.reasons == ("no_path",)


def test_a_start_without_free_ground_nearby_is_refused() -> None:
    with pytest.raises(RefusedError, match="no free ground") as refused:
        Guidance(5.0).leg(ground((-2.0, 2.0, -2.0, 2.0, UNKNOWN)), START_XY, np.array([5.0, 0.0]))
    assert refused.value.reasons == ("no_path",)


def test_from_forbidden_ground_the_path_leads_to_the_nearest_free_cell_first() -> None:
    navigation_map = ground((-0.6, 0.6, -0.6, 0.6, UNKNOWN))
    path = Guidance(50.0).leg(navigation_map, START_XY, np.array([5.1, 0.1]))
    assert path[0] == pytest.approx(START_XY)
    assert np.linalg.norm(path[1] - START_XY) < 1.0
    assert crossed_classes(navigation_map, path[1:]) == {SAFE}


def test_a_leg_ends_at_a_reversal_so_that_the_rover_turns_in_place() -> None:
    reversing = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.5], [0.5, 1.0], [0.0, 3.0]])
    assert sharpest_turn_rad(reversing) > MAX_CORNER_RAD
    assert _up_to_sharp_turn(reversing).tolist() == reversing[:3].tolist()
    gentle = reversing[[0, 1, 2, 4]]
    assert sharpest_turn_rad(gentle) < MAX_CORNER_RAD
    assert _up_to_sharp_turn(gentle).tolist() == gentle.tolist()


def test_a_path_does_not_return_to_the_centre_of_the_start_cell() -> None:
    position = np.array([0.19, 0.1])
    path = Guidance(50.0).leg(ground(), position, np.array([5.1, 0.1]))
    assert path[0] == pytest.approx(position)
    assert np.diff(path[:, 0]).min() > 0.0


@pytest.mark.req("CDFF-DEV-072")
def test_in_a_dead_end_the_path_leads_out_without_oscillation() -> None:
    # A dead end that is open to the west only, in front of a wall that extends beyond the map.
    navigation_map = ground((3.0, 3.4, -HALF_M, HALF_M, HAZARD), (0.6, 3.4, 1.6, 2.0, HAZARD))
    guidance, position, ends = Guidance(7.0), START_XY, []
    for _ in range(6):
        position = guidance.leg(navigation_map, position, np.array([30.0, 3.0]))[-1]
        ends.append(position)
    distances_m = [np.linalg.norm(a - b) for i, a in enumerate(ends) for b in ends[:i]]
    assert min(distances_m) > 1.0
    assert np.ptp(np.array(ends), axis=0).max() > 4.0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Contact of boxes with regions, and distances from a point, against points sampled from both shapes."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_common.geometry.region import parse_region
from dpm_store.search.outlines import (
    corners_of,
    distances_m,
    footprint_distances_m,
    footprints_touch,
    touches,
)

IDENTITY = np.eye(4)
#: A box of 2 x 2 x 2 m around the origin, and its neighbours at one side each.
UNIT = (-1.0, -1.0, -1.0, 1.0, 1.0, 1.0)
SHIFTS = [
    (3.0, 0.0, 0.0),
    (-3.0, 0.0, 0.0),
    (0.0, 3.0, 0.0),
    (0.0, -3.0, 0.0),
    (0.0, 0.0, 3.0),
    (0.0, 0.0, -3.0),
]


def shifted(shift: tuple[float, float, float]) -> np.ndarray:
    return np.array([UNIT]) + np.array([*shift, *shift])


@pytest.mark.parametrize("shift", SHIFTS)
def test_a_box_beyond_any_side_of_a_box_does_not_touch_it(shift: tuple[float, float, float]) -> None:
    region = parse_region("box:-1,-1,-1,1,1,1")
    at_the_side = tuple(2.0 / 3.0 * value for value in shift)
    boxes = np.concatenate([shifted(shift), shifted(at_the_side), np.array([UNIT])])
    assert touches(region, boxes, IDENTITY).tolist() == [False, True, True]


def test_heights_count_for_boxes_only() -> None:
    above = shifted((0.0, 0.0, 3.0))
    for text in ("bbox:-1,-1,1,1", "circle:0,0,1", "polygon:-1,-1,1,-1,1,1,-1,1", "path:1,-1,0,1,0"):
        assert touches(parse_region(text), above, IDENTITY).tolist() == [True]
    assert touches(parse_region("box:-1,-1,-1,1,1,1"), above, IDENTITY).tolist() == [False]


def test_the_corner_of_a_box_touches_a_circle_at_its_distance() -> None:
    boxes = np.array([[3.0, 4.0, 0.0, 5.0, 6.0, 1.0]])
    assert touches(parse_region("circle:0,0,5"), boxes, IDENTITY).tolist() == [True]
    assert touches(parse_region("circle:0,0,4.999"), boxes, IDENTITY).tolist() == [False]
    assert distances_m((0.0, 0.0), boxes, IDENTITY) == pytest.approx([5.0])
    assert distances_m((4.0, 5.0), boxes, IDENTITY) == pytest.approx([0.0])


@pytest.mark.parametrize(
    "text", ["bbox:0,0,4,2", "circle:1,2,2.5", "polygon:0,0,5,1,2,4", "path:1,-3,0,2,2,4,-1"]
)
def test_rotated_boxes_touch_a_region_that_contains_one_of_their_points(
    text: str, rng: np.random.Generator
) -> None:
    region = parse_region(text)
    T = se3.transform(se3.exp_so3(np.array([0.0, 0.0, 0.6])), np.array([0.5, -0.3, 0.2]))
    low = rng.uniform(-6.0, 6.0, (200, 3))
    boxes = np.hstack([low, low + rng.uniform(0.2, 2.0, (200, 3))])
    grid = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 25)] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    expected = []
    for box in boxes:
        inside = np.column_stack([box[:2] + grid * (box[3:5] - box[:2]), np.full(len(grid), box[2])])
        expected.append(bool(region.contains(*se3.transform_points(T, inside)[:, :2].T).any()))
    is_touching = touches(region, boxes, T)
    assert not (np.array(expected) & ~is_touching).any()
    assert (is_touching & ~np.array(expected)).sum() <= 12  # contact between the points of the grid
    assert 20 < is_touching.sum() < 180


def test_distances_to_rotated_boxes_are_those_to_their_corners_or_edges() -> None:
    T = se3.transform(se3.exp_so3(np.array([0.0, 0.0, np.pi / 4.0])), np.zeros(3))
    distance = distances_m((3.0, 0.0), np.array([UNIT]), T)  # a corner lies on the x-axis
    assert distance == pytest.approx([3.0 - np.sqrt(2.0)])


def test_footprints_are_used_instead_of_boxes() -> None:
    triangle = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 4.0]])
    heights, far_corner = np.array([[0.0, 1.0]]), parse_region("bbox:3,3,4,4")
    box = np.array([[0.0, 0.0, 0.0, 4.0, 4.0, 1.0]])
    assert touches(far_corner, box, IDENTITY).tolist() == [True]
    assert footprints_touch(far_corner, [triangle], heights, IDENTITY).tolist() == [False]
    assert footprint_distances_m((4.0, 4.0), [triangle], heights, IDENTITY) == pytest.approx([np.sqrt(8.0)])


def test_a_tilted_footprint_covers_both_heights() -> None:
    square, heights = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]), np.array([[0.0, 4.0]])
    tilted = se3.transform(se3.exp_so3(np.array([0.0, np.pi / 2.0, 0.0])), np.zeros(3))  # z becomes x
    assert footprint_distances_m((6.0, 0.0), [square], heights, tilted) == pytest.approx([2.0])
    assert footprint_distances_m((-3.0, 0.0), [square], heights, tilted) == pytest.approx([3.0])


def test_the_corners_of_a_box_are_all_combinations_of_its_limits() -> None:
    corners = corners_of(np.array([[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]))[0]
    assert {tuple(c) for c in corners.tolist()} == {
        (x, y, z) for x in (1.0, 4.0) for y in (2.0, 5.0) for z in (3.0, 6.0)
    }

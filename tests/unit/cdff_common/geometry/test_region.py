# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Regions: text form, contained points, area and bounds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry.region import parse_region

TEXTS = [
    "bbox:-10,-5,10,5",
    "box:0,0,0,1,2,3",
    "circle:1,2,3",
    "polygon:0,0,4,0,0,4",
    "near:mana/base,10",
    "path:2,0,0,10,0,10,10",
]


@pytest.mark.parametrize("text", TEXTS)
def test_a_region_survives_a_round_trip(text: str) -> None:
    assert parse_region(text).text == text
    assert parse_region(parse_region(text).text) == parse_region(text)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "bbox",
        "bbox:1,2,3",
        "bbox:0,0,0,1",
        "box:0,0,1,1,1,0",
        "circle:0,0,-1",
        "circle:0,0,nan",
        "circle:0,0,1e999",
        "polygon:0,0,1,1",
        "polygon:0,0,1,1,2",
        "polygon:0,0,1,1,2,2",
        "polygon:0,0,4,0,0,4,1",
        "near:Mana,3",
        "near:mana/base",
        "near:mana/base,0",
        "blob:1,2",
        "path:1",
        "path:1,0,0",
        "path:1,0,0,1",
        "path:1,0,0,1,1,2",
        "path:0,0,0,1,1",
        "path:-1,0,0,1,1",
        "path:1,0,0,nan,1",
    ],
)
def test_a_malformed_region_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        parse_region(text)


def test_each_form_of_region_contains_the_points_inside_it() -> None:
    x, y = np.array([0.5, 3.0, 2.0]), np.array([0.5, 3.0, 1.0])
    assert parse_region("bbox:0,0,2,2").contains(x, y).tolist() == [True, False, True]
    assert parse_region("circle:0,0,1").contains(x, y).tolist() == [True, False, False]
    assert parse_region("polygon:0,0,4,0,0,4").contains(x, y).tolist() == [True, False, True]
    assert parse_region("box:0,0,0,2,2,1").contains(x, y, np.array([0.5, 0.5, 2.0])).tolist() == [
        True,
        False,
        False,
    ]


def test_a_concave_polygon_excludes_its_notch() -> None:
    notched = parse_region("polygon:0,0,4,0,4,4,2,1,0,4")
    assert notched.contains([2.0, 2.0], [0.5, 2.0]).tolist() == [True, False]


def test_a_region_near_a_frame_has_no_position_until_it_is_resolved() -> None:
    region = parse_region("near:mana/base,10")
    with pytest.raises(InputError, match="mana/base"):
        region.contains([0.0], [0.0])
    assert region.resolved(1.0, 2.0).text == "circle:1,2,10"


def test_the_bounding_box_is_unbounded_in_z_unless_the_region_is_a_box() -> None:
    assert parse_region("circle:1,2,3").box_m == (-2, -1, -math.inf, 4, 5, math.inf)
    assert parse_region("box:0,0,0,1,2,3").box_m == (0, 0, 0, 1, 2, 3)


def test_polygons_that_share_an_edge_share_no_point(rng: np.random.Generator) -> None:
    x, y = rng.uniform(0, 2, (2, 5000))
    left, right = parse_region("polygon:0,0,1,0,1.3,2,0,2"), parse_region("polygon:1,0,2,0,2,2,1.3,2")
    hits = left.contains(x, y).astype(int) + right.contains(x, y).astype(int)
    assert (hits == 1).all()


def test_the_area_of_a_polygon_excludes_its_notch() -> None:
    assert parse_region("polygon:0,0,4,0,4,4,2,1,0,4").area_m2 == pytest.approx(16 - 6)


def test_a_path_contains_points_within_its_distance() -> None:
    path = parse_region("path:1,0,0,10,0,10,10")
    x = np.array([5.0, 5.0, -0.7, -0.8, 11.0, 10.7, 10.8])
    y = np.array([1.0, 1.01, 0.7, 0.8, 5.0, 10.7, 10.8])
    assert path.contains(x, y).tolist() == [True, False, True, False, True, True, False]
    assert path.bounds == (-1.0, -1.0, 11.0, 11.0)
    corridor_m2 = (
        2 * 20.0 + math.pi - (1.0 - math.pi / 4)
    )  # straight sections and round ends, without the overlap at the bend
    assert path.area_m2 == pytest.approx(corridor_m2, rel=1e-3)


def test_a_path_with_coincident_points_is_a_circle(rng: np.random.Generator) -> None:
    x, y = rng.uniform(-3, 3, (2, 500))
    assert np.array_equal(
        parse_region("path:2,0,0,0,0").contains(x, y), parse_region("circle:0,0,2").contains(x, y)
    )


def test_the_pieces_of_a_long_path_cover_it(rng: np.random.Generator) -> None:
    points = rng.uniform(-100, 100, (900, 2)).cumsum(axis=0)
    path = parse_region("path:3," + ",".join(f"{v:.3f}" for v in points.ravel()))
    assert len(path.pieces) <= 64
    x, y = rng.uniform(points.min(axis=0), points.max(axis=0), (20_000, 2)).T
    inside = path.contains(x, y)
    covered = np.zeros(len(x), dtype=bool)
    for x0, y0, _, x1, y1, _ in path.pieces:
        covered |= (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
    assert inside.any()
    assert covered[inside].all()


def test_the_centre_of_a_path_is_on_it() -> None:
    assert parse_region("path:1,0,0,10,0,10,10").centre == (10.0, 0.0)
    assert parse_region("bbox:0,0,2,4").centre == (1.0, 2.0)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.raster import GridGeometry, Region


@pytest.mark.parametrize(
    "text",
    ["bbox:-10,-5,10,5", "box:0,0,-1,4,5,6", "circle:1.5,2,10", "polygon:0,0,4,0,4,3", "near:mana/base,7.5"],
)
def test_a_region_reads_back_from_its_text(text: str) -> None:
    region = Region.parse(text)
    assert region.text == text
    assert Region.parse(region.text) == region


@pytest.mark.parametrize(
    "text",
    [
        "",
        "bbox",
        "bbox:1,2,3",
        "bbox:0,0,0,1",
        "bbox:0,0,nan,1",
        "bbox:a,0,1,1",
        "box:0,0,5,1,1,5",
        "circle:0,0,0",
        "circle:0,0,-1",
        "polygon:0,0,1,1",
        "polygon:0,0,1,1,2,2",
        "polygon:0,0,1,1,2",
        "near:mana/base",
        "near:Mana,3",
        "near:,3",
        "near:mana/base,inf",
        "ellipse:0,0,1,2",
        "bbox:0,0,1,1,1",
    ],
)
def test_a_malformed_region_is_refused(text: str) -> None:
    with pytest.raises(InputError):
        Region.parse(text)


def test_a_bbox_holds_its_lower_left_edges_so_that_neighbours_share_no_cell() -> None:
    region = Region.parse("bbox:0,0,1,1")
    assert region.contains([0, 1, 0.5, -0.1], [0, 0.5, 1, 0.5]).tolist() == [True, False, False, False]


def test_a_circle_counts_cells_by_their_centres() -> None:
    g = GridGeometry.aligned("site", 0.1, (-2, -2, 2, 2))
    inside = Region.parse("circle:0,0,1").mask(g)
    assert np.count_nonzero(inside) * 0.01 == pytest.approx(np.pi, rel=0.01)


def test_a_polygon_with_a_notch_leaves_the_notch_out() -> None:
    region = Region.parse("polygon:0,0,4,0,4,4,2,1,0,4")
    assert region.contains([2, 2, 0.5, 3.5, 5], [0.5, 3, 2, 2, 1]).tolist() == [True, False, True, True, False]
    assert region.area_m2 == pytest.approx(16 - 6)


def test_polygons_that_share_an_edge_share_no_point(rng: np.random.Generator) -> None:
    x, y = rng.uniform(0, 2, (2, 5000))
    left, right = Region.parse("polygon:0,0,1,0,1.3,2,0,2"), Region.parse("polygon:1,0,2,0,2,2,1.3,2")
    hits = left.contains(x, y).astype(int) + right.contains(x, y).astype(int)
    assert (hits == 1).all()


def test_near_is_a_circle_once_its_frame_is_found() -> None:
    region = Region.parse("near:mana/base,5")
    assert region.near_frame == "mana/base"
    with pytest.raises(InputError, match="mana/base"):
        _ = region.bounds
    assert region.resolved(1, 2) == Region.parse("circle:1,2,5")
    assert Region.parse("bbox:0,0,1,1").resolved(3, 4) == Region.parse("bbox:0,0,1,1")


def test_a_box_also_spans_heights() -> None:
    assert Region.parse("box:0,0,-1,4,5,6").z_range_m == (-1.0, 6.0)
    assert Region.parse("bbox:0,0,1,1").z_range_m is None


def test_coverage_is_the_share_of_observed_cells_also_where_the_grid_is_smaller_than_the_region() -> None:
    g = GridGeometry.aligned("site", 0.1, (0, 0, 2, 1))
    observed = np.zeros(g.shape, dtype=bool)
    observed[:, :10] = True
    assert Region.parse("bbox:0,0,2,1").coverage(g, observed) == pytest.approx(0.5)
    assert Region.parse("bbox:0,0,1,1").coverage(g, observed) == pytest.approx(1.0)
    assert Region.parse("bbox:0,0,4,2").coverage(g, observed) == pytest.approx(1.0 / 8.0)
    assert Region.parse("bbox:10,10,12,12").coverage(g, observed) == 0.0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Footprints contain all of the data, and searches by region use them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import parse_region
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, Pointcloud
from dpm_store import Query, Store
from dpm_store.search.footprints import footprint_of, outline
from tests.support.store_products import header, put

BOX = (0.0, 0.0, 0.0, 10.0, 10.0, 1.0)
#: Polygon in the form of an L: the box without its upper right quarter.
L_SHAPE = (0.0, 0.0, 10.0, 0.0, 10.0, 5.0, 5.0, 5.0, 5.0, 10.0, 0.0, 10.0)


def sequence_numbers(store: Store, region: str, **fields: Any) -> list[int]:
    return [r.header.seq for r in store.search(Query(region=parse_region(region), **fields)).items]


@pytest.mark.req("CDFF-SUP-082")
def test_a_region_in_the_notch_of_a_footprint_finds_nothing(store: Store) -> None:
    put(store, header(1, box_m=BOX, footprint_m=L_SHAPE))
    put(store, header(2, box_m=BOX))
    assert sequence_numbers(store, "bbox:7,7,9,9") == [2]
    assert sequence_numbers(store, "circle:9,9,1") == [2]
    assert sequence_numbers(store, "path:1,6.5,20,6.5,6.5") == [2]
    assert sequence_numbers(store, "bbox:1,1,9,9") == [2, 1]


def test_a_footprint_rotates_with_its_frame(store: Store) -> None:
    store.frames.set(
        "mana/odom", "site", UncertainTransform(se3.transform(se3.exp_so3([0, 0, np.pi]), [10, 10, 0]))
    )
    put(store, header(1, frame="mana/odom", box_m=BOX, footprint_m=L_SHAPE))
    assert sequence_numbers(store, "bbox:1,1,3,3") == []
    assert sequence_numbers(store, "bbox:7,7,9,9") == [1]


def l_shaped_map() -> ElevationMap:
    """Return a map of 0.1 m whose observed cells form an L."""
    grid = GridGeometry("site", 0.1, 0.0, 10.0, 100, 100)
    mean = np.zeros((100, 100), np.float32)
    mean[:50, 50:] = np.nan
    return ElevationMap.from_layers(grid, {"mean": mean}, t0_ns=0, t1_ns=0)


def test_the_footprint_of_a_map_contains_its_observed_cells(store: Store) -> None:
    put(store, header(1, box_m=BOX), b"map", value=l_shaped_map())
    assert sequence_numbers(store, "bbox:7,7,9,9") == []
    assert sequence_numbers(store, "bbox:1,7,2,9") == [1]


def test_the_footprint_of_a_cloud_contains_its_points(rng: np.random.Generator) -> None:
    points = rng.uniform(0, 10, (20_000, 3))
    points = points[(points[:, 0] < 5) | (points[:, 1] < 5)]
    ring = footprint_of(header(1, box_m=BOX), Pointcloud.from_points(points, frame="site", stamp_ns=0))
    assert ring is not None
    polygon = shapely.Polygon(ring).buffer(1e-6)
    assert shapely.contains_xy(polygon, points[:, 0], points[:, 1]).all()
    assert not polygon.intersects(shapely.box(6, 6, 9, 9))


def test_a_map_that_fills_its_box_needs_no_footprint() -> None:
    grid = GridGeometry("site", 0.1, 0.0, 10.0, 100, 100)
    full = ElevationMap.from_layers(grid, {"mean": np.zeros((100, 100), np.float32)}, t0_ns=0, t1_ns=0)
    assert footprint_of(header(1, box_m=BOX), full) is None


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.02, 0.9))
def test_an_outline_contains_every_occupied_cell(seed: int, share: float) -> None:
    occupied = np.random.default_rng(seed).random((24, 17)) < share
    occupied[3, 4] = True
    ring = outline(occupied, -2.0, 5.0, 0.5, 0.25)
    polygon = shapely.Polygon(ring)
    assert polygon.is_valid
    rows, columns = np.nonzero(occupied)
    x, y = -2.0 + columns * 0.5, 5.0 - rows * 0.25
    assert shapely.covers(polygon.buffer(1e-9), shapely.box(x, y - 0.25, x + 0.5, y)).all()


@pytest.mark.parametrize(
    ("ring", "reason"),
    [
        ((0, 0, 1, 1, 1, 0, 0, 1), "expected an outline"),
        ((0, 0, 5, 5, 10, 10), "expected an outline"),
        ((0, 0, 20, 0, 0, 5), "reaches out"),
        ((0, 0, float("nan"), 0, 0, 5), "finite"),
        ((0, 0, 1, 1), "3 to"),
        ((0, 0, 1, 1, 2), "3 to"),
    ],
)
def test_an_invalid_footprint_is_refused(store: Store, ring: tuple[float, ...], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        put(store, header(1, box_m=BOX, footprint_m=ring))
    assert store.search().items == ()


def test_a_footprint_needs_a_box(store: Store) -> None:
    with pytest.raises(InputError, match="box_m"):
        put(store, header(1, footprint_m=L_SHAPE))

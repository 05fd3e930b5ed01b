# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Windows and tiles of navigation maps from a store."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import parse_region
from cdff_common.raster import GridGeometry
from cdff_common.raster.cell_selection import NavigationChoice
from cdff_common.raster.tiles import Tile, tiles_over
from cdff_common.types import NavigationMap
from dpm_store import Store
from dpm_store.maps.windows import Window, WindowQuery
from tests.support.map_products import S, put_value


def put_map(
    store: Store, value: int, seq: int, *, left: int = 0, frame: str = "site", robot: str = "mana"
) -> str:
    """Insert a map of 20 x 20 cells of 0.1 m of one class with its lower left corner in cell (left, 0)."""
    geometry = GridGeometry.from_cells(frame, 0.1, left=left, top=20, rows=20, cols=20)
    layers = {
        "class": np.full(geometry.shape, value, dtype=np.uint8),
        "cost": np.full(geometry.shape, value / 3.0, dtype=np.float32),
    }
    navigation_map = NavigationMap.from_layers(geometry, layers, t0_ns=seq * S, t1_ns=seq * S)
    return put_value(store, navigation_map, "navigation_map", seq, robot, resolution_m=0.1)


def window(store: Store, region: str = "bbox:0,0,2,2", **fields: Any) -> Window:
    return store.maps.navigation.window(WindowQuery(parse_region(region), **fields))


@pytest.mark.req("CDFF-SUP-184")
@pytest.mark.parametrize(
    ("choice", "expected"),
    [(NavigationChoice.NEWEST, 1), (NavigationChoice.OLDEST, 2), (NavigationChoice.WORST, 3)],
)
def test_each_cell_is_from_one_of_several_maps(store: Store, choice: NavigationChoice, expected: int) -> None:
    ids = [put_map(store, value, seq) for seq, value in enumerate((2, 3, 1), 1)]
    assembled = window(store, navigation_choice=choice)
    assert set(assembled.map.layer("class").ravel()) == {expected}
    np.testing.assert_allclose(assembled.map.layer("cost"), expected / 3.0, rtol=1e-6)
    assert assembled.patches == tuple(sorted(ids))
    assert (assembled.coverage, assembled.disagreeing, assembled.newest_ns) == (1.0, 400, 3 * S)
    others = [
        window(store, navigation_choice=other).header.id for other in NavigationChoice if other != choice
    ]
    assert assembled.header.id not in others
    assert assembled.header.id == window(store, navigation_choice=choice).header.id


def test_a_window_is_restricted_to_a_region_a_robot_and_a_time(store: Store) -> None:
    put_map(store, 1, 1, robot="mana")
    put_map(store, 3, 2, left=10, robot="minnie")
    assembled = window(store, "bbox:0,0,4,2")
    assert assembled.robots == ("mana", "minnie")
    assert assembled.map.layer("class")[0].tolist() == [1] * 10 + [3] * 20 + [0] * 10
    assert np.isnan(assembled.map.layer("cost")[0, 30:]).all()
    assert assembled.coverage == pytest.approx(0.75)
    assert set(window(store, robot="mana").map.layer("class").ravel()) == {1}
    assert set(window(store, t1_ns=S).map.layer("class").ravel()) == {1}
    assert window(store, "circle:1,1,0.5").map.layer("class")[0, 0] == 0
    with pytest.raises(ProductNotFoundError, match="no navigation_map patch in bbox:50"):
        window(store, "bbox:50,50,51,51")
    with pytest.raises(ProductNotFoundError, match="ended at"):
        window(store, newest_after_ns=9 * S)


def test_a_coarser_window_has_the_worst_class_and_moves_with_its_frame(store: Store) -> None:
    store.frames.set("mana/odom", "site", UncertainTransform(se3.transform(np.eye(3), [10.0, 0.0, 0.0])))
    put_map(store, 2, 1, frame="mana/odom")
    assembled = window(store, "bbox:10,0,12,2", resolution_m=0.5)
    assert assembled.map.layer("class").tolist() == [[2] * 4] * 4
    assert assembled.header.resolution_m == 0.5
    state = assembled.frames_revision
    store.frames.set("mana/odom", "site", UncertainTransform(se3.transform(np.eye(3), [20.0, 0.0, 0.0])))
    with pytest.raises(ProductNotFoundError):
        window(store, "bbox:10,0,12,2")
    earlier = window(store, "bbox:10,0,12,2", resolution_m=0.5, frames_revision=state)
    assert earlier.map.layer("class").tolist() == assembled.map.layer("class").tolist()


def test_tiles_of_many_maps_are_aggregated_without_losing_a_hazard(store: Store) -> None:
    for seq in range(30):  # more maps than a tile assembles directly
        put_map(store, 3 if seq == 7 else 1, seq, left=20 * seq)
    columns, rows = tiles_over(13, (30.0, 1.0, 30.0, 1.0))
    tile = Tile(13, columns[0], rows[0])  # cells of 1.6 m
    layers = store.maps.navigation.tile("site", tile)
    geometry = tile.geometry("site")
    row = int((geometry.ymax_m - 0.8) / 1.6)
    x = geometry.x_centres_m()
    classes = layers["class"][row][(x > 0) & (x < 60)]
    assert set(classes) == {1, 3}
    assert 2 <= (classes == 3).sum() <= 3  # the 2 m of the hazard in cells of 1.6 m
    assert set(layers["cost"][layers["class"] == 3]) == {1.0}

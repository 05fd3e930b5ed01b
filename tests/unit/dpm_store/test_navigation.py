# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Windows and tiles of navigation maps out of a store."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ProductNotFoundError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import parse_region
from cdff_common.raster import GridGeometry
from cdff_common.raster.choice import NavigationChoice
from cdff_common.raster.tiles import Tile, tiles_over
from cdff_common.types import NavigationMap
from dpm_store import Store
from dpm_store.windows import Window, WindowQuery

from .map_products import S, put_value


def put_map(store: Store, value: int, seq: int, *, left: int = 0, frame: str = "site", robot: str = "mana") -> str:
    """A map of 20 x 20 cells of one class, its lower left corner at (left, 0) cells of 0.1 m."""
    geometry = GridGeometry.from_cells(frame, 0.1, left=left, top=20, rows=20, cols=20)
    layers = {
        "class": np.full(geometry.shape, value, dtype=np.uint8),
        "cost": np.full(geometry.shape, value / 3.0, dtype=np.float32),
    }
    made = NavigationMap.from_layers(geometry, layers, t0_ns=seq * S, t1_ns=seq * S)
    return put_value(store, made, "navigation_map", seq, robot, resolution_m=0.1)


def window(store: Store, region: str = "bbox:0,0,2,2", **fields: Any) -> Window:
    return store.maps.navigation.window(WindowQuery(parse_region(region), **fields))


@pytest.mark.req("CDFF-SUP-184")
@pytest.mark.parametrize(
    ("judgement", "wanted"),
    [(NavigationChoice.NEWEST, 1), (NavigationChoice.OLDEST, 2), (NavigationChoice.WORST, 3)],
)
def test_of_several_maps_one_judges_each_cell(store: Store, judgement: NavigationChoice, wanted: int) -> None:
    ids = [put_map(store, value, seq) for seq, value in enumerate((2, 3, 1), 1)]
    found = window(store, judgement=judgement)
    assert set(found.map.layer("class").ravel()) == {wanted}
    np.testing.assert_allclose(found.map.layer("cost"), wanted / 3.0, rtol=1e-6)
    assert found.patches == tuple(sorted(ids))
    assert (found.coverage, found.disagreeing, found.newest_ns) == (1.0, 400, 3 * S)
    others = [window(store, judgement=other).header.id for other in NavigationChoice if other != judgement]
    assert found.header.id not in others
    assert found.header.id == window(store, judgement=judgement).header.id


def test_a_window_is_of_a_region_a_robot_and_a_time(store: Store) -> None:
    put_map(store, 1, 1, robot="mana")
    put_map(store, 3, 2, left=10, robot="minnie")
    found = window(store, "bbox:0,0,4,2")
    assert found.robots == ("mana", "minnie")
    assert found.map.layer("class")[0].tolist() == [1] * 10 + [3] * 20 + [0] * 10
    assert np.isnan(found.map.layer("cost")[0, 30:]).all()
    assert found.coverage == pytest.approx(0.75)
    assert set(window(store, robot="mana").map.layer("class").ravel()) == {1}
    assert set(window(store, t1_ns=S).map.layer("class").ravel()) == {1}
    assert window(store, "circle:1,1,0.5").map.layer("class")[0, 0] == 0
    with pytest.raises(ProductNotFoundError, match="no navigation_map patch in bbox:50"):
        window(store, "bbox:50,50,51,51")
    with pytest.raises(ProductNotFoundError, match="ended at"):
        window(store, newest_after_ns=9 * S)


def test_a_window_is_coarsened_by_the_worst_and_moves_with_its_frame(store: Store) -> None:
    store.frames.set("mana/odom", "site", UncertainTransform(se3.transform(np.eye(3), [10.0, 0.0, 0.0])))
    put_map(store, 2, 1, frame="mana/odom")
    found = window(store, "bbox:10,0,12,2", resolution_m=0.5)
    assert found.map.layer("class").tolist() == [[2] * 4] * 4
    assert found.header.resolution_m == 0.5
    state = found.frames_revision
    store.frames.set("mana/odom", "site", UncertainTransform(se3.transform(np.eye(3), [20.0, 0.0, 0.0])))
    with pytest.raises(ProductNotFoundError):
        window(store, "bbox:10,0,12,2")
    again = window(store, "bbox:10,0,12,2", resolution_m=0.5, frames_revision=state)
    assert again.map.layer("class").tolist() == found.map.layer("class").tolist()


def test_tiles_of_many_maps_are_those_of_the_tiles_below_and_lose_no_hazard(store: Store) -> None:
    for seq in range(30):  # more than are assembled at once
        put_map(store, 3 if seq == 7 else 1, seq, left=20 * seq)
    columns, rows = tiles_over(13, (30.0, 1.0, 30.0, 1.0))
    tile = Tile(13, columns[0], rows[0])  # cells of 1.6 m
    layers = store.maps.navigation.tile("site", tile)
    geometry = tile.geometry("site")
    row = int((geometry.ymax_m - 0.8) / 1.6)
    x = geometry.x_centres_m()
    here = layers["class"][row][(x > 0) & (x < 60)]
    assert set(here) == {1, 3}
    assert 2 <= (here == 3).sum() <= 3  # the two metres of the hazard
    assert set(layers["cost"][layers["class"] == 3]) == {1.0}

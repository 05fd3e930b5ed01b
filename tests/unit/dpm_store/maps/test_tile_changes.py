# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rectangles that events change, and the tiles that they touch."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform, se3
from dpm_store import Store
from dpm_store.maps.tile_changes import Change, MapChanges, tiles_of_change
from tests.support.store_products import header, put


def test_a_revision_of_the_frames_changes_the_previous_and_the_new_place_of_the_maps(store: Store) -> None:
    """Each event is evaluated with the frames after it, also when later revisions follow."""
    put(store, header(1, frame="mana/odom", box_m=(0.0, 0.0, 0.0, 10.0, 10.0, 1.0)))
    for x_m in (0.0, 100.0, 300.0):
        T = UncertainTransform(se3.transform(np.eye(3), [x_m, 0.0, 0.0]))
        store.frames.set("mana/odom", "site", T)
    changes = MapChanges(store._database, store.frames, {"site"})
    events = [event for event in store.events.since() if event.kind == "reanchored"]
    left_m = [[change.bounds[0] for change in changes.of(event)] for event in events]
    assert left_m == [[0.0], [0.0, 100.0], [100.0, 300.0]]


@pytest.mark.parametrize(("margin_cells", "reach"), [(0, 0), (1, 0), (3, 1)])
def test_a_change_touches_the_tiles_within_the_margin(margin_cells: int, reach: int) -> None:
    """At level 18, 256 cells of 0.05 m, the change leaves two cells of a tile at each side."""
    z, column, row = 18, 1 << 17, (1 << 17) - 1
    change = Change("site", (0.1, 0.1, 12.7, 12.7))
    around = [("site", z, column + i, row + j) for i in range(-2, 3) for j in range(-2, 3)]
    others = [("mana/odom", z, column, row), ("site", z - 1, column, row)]
    touched = tiles_of_change([*around, *others], change, margin_cells)
    expected = [k for k in around if abs(k[2] - column) <= reach and abs(k[3] - row) <= reach]
    assert touched == expected

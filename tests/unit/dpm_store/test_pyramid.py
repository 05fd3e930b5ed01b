# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tiles: at every level what the points themselves would give, and never what was there before."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster import CellStatistics
from cdff_common.raster.tiles import HALF_SIDE_M, LAST_LEVEL, Tile, cell_m, level_of, tile_matrix_set, tiles_over
from dpm_store import Store, open_store
from dpm_store.pyramid import FEW, Change, touched
from tests.unit.dpm_store.map_products import S, parcel_of, patch, put_patch


def tile_at(z: int, x_m: float, y_m: float) -> Tile:
    columns, rows = tiles_over(z, (x_m, y_m, x_m, y_m))
    return Tile(z, columns[0], rows[0])


def cells(store: Store, tile: Tile, margin: int = 0) -> CellStatistics:
    return store.pyramid.statistics("site", tile.z, tile.geometry("site", margin))


def assert_equal_to_points(store: Store, tile: Tile, points: np.ndarray, margin: int = 0) -> None:
    found = cells(store, tile, margin)
    direct = CellStatistics.from_points(tile.geometry("site", margin), points, stamps_ns=0)
    for name in ("count", "mean", "m2"):
        np.testing.assert_allclose(getattr(found, name), getattr(direct, name), rtol=3e-4, atol=2e-5, err_msg=name)


def test_the_grid_is_a_tile_matrix_set_of_powers_of_two() -> None:
    document = tile_matrix_set("site", {"uri": "x"})
    first, last = document["tileMatrices"][0], document["tileMatrices"][-1]
    assert (first["matrixWidth"], last["matrixWidth"]) == (1, 1 << LAST_LEVEL)
    assert first["cellSize"] * 256 == 2 * HALF_SIDE_M
    assert first["scaleDenominator"] == pytest.approx(first["cellSize"] / 0.00028)
    for coarse, fine in zip(document["tileMatrices"], document["tileMatrices"][1:], strict=False):
        assert coarse["cellSize"] == 2 * fine["cellSize"]


def test_a_level_is_found_by_the_size_of_its_cells() -> None:
    assert [level_of(r) for r in (0.0125, 0.05, 0.06, 0.1, 0.4, 1e9)] == [20, 18, 17, 17, 15, 0]
    assert cell_m(18) == pytest.approx(0.05)
    assert tile_at(1, 1.0, 1.0) == Tile(1, 1, 0)
    assert Tile(1, 1, 0).geometry("site").bounds == (0.0, 0.0, HALF_SIDE_M, HALF_SIDE_M)
    assert {t.geometry("site").bounds for t in Tile(17, 5, 6).children()} == {
        t.geometry("site").bounds for t in (Tile(18, x, y) for x in (10, 11) for y in (12, 13))
    }


@pytest.mark.parametrize("address", [(-1, 0, 0), (21, 0, 0), (3, 8, 0), (3, 0, -1)])
def test_tiles_beyond_the_grid_are_refused(address: tuple[int, int, int]) -> None:
    with pytest.raises(InputError, match="tile"):
        Tile(*address)


@pytest.mark.req("CDFF-SUP-181")
def test_few_patches_make_a_tile_at_every_level(store: Store, rng: np.random.Generator) -> None:
    points = np.vstack([put_patch(store, rng, (i, 1.0, i + 3.0, 4.0), i + 1)[1] for i in range(4)])
    for z in (17, 16, 12, 0):
        assert_equal_to_points(store, tile_at(z, 1.0, 1.0), points)
    assert not cells(store, tile_at(18, 1.0, 1.0)).observed.any()  # patches of 10 cm are not made finer
    assert not cells(store, tile_at(17, 500.0, 1.0)).observed.any()


def crowd(store: Store, rng: np.random.Generator, count: int = FEW + 20) -> np.ndarray:
    """Patches of 20 cm, more than a tile is made from directly."""
    corners = rng.uniform(-20.0, 60.0, (count, 2))
    made = [patch(rng, (x, y, x + 6.0, y + 6.0), seq, cell_m=0.2, n=1500) for seq, (x, y) in enumerate(corners, 1)]
    store.put_all([parcel_of(value, "dem", seq, resolution_m=0.2) for seq, (value, _) in enumerate(made, 1)])
    return np.vstack([points for _, points in made])


@pytest.mark.parametrize("margin", [0, 1])
def test_many_patches_are_pooled_from_level_to_level(store: Store, rng: np.random.Generator, margin: int) -> None:
    points = crowd(store, rng)
    for z in (16, 15, 14, 10, 0):
        assert_equal_to_points(store, tile_at(z, 10.0, 10.0), points, margin)


def test_coarse_patches_count_at_their_own_levels(store: Store, rng: np.random.Generator) -> None:
    fine = crowd(store, rng)
    _, coarse = put_patch(store, rng, (-16.0, -16.0, 48.0, 48.0), 500, cell_m=0.8, n=20_000)
    assert_equal_to_points(store, tile_at(15, 10.0, 10.0), fine)
    for z in (14, 12, 0):
        assert_equal_to_points(store, tile_at(z, 10.0, 10.0), np.vstack([fine, coarse]))


@pytest.mark.req("CDFF-SUP-181")
def test_insertions_and_deletions_are_seen_at_every_level(store: Store, rng: np.random.Generator) -> None:
    points = crowd(store, rng)
    tiles = [tile_at(z, 10.0, 10.0) for z in (16, 14, 0)]
    for tile in tiles:
        cells(store, tile)
    new_id, more = put_patch(store, rng, (8.0, 8.0, 12.0, 12.0), 900)
    for tile in tiles:
        assert_equal_to_points(store, tile, np.vstack([points, more]))
    store.delete(new_id)
    for tile in tiles:
        assert_equal_to_points(store, tile, points)


def test_a_change_drops_only_what_it_touches(store: Store, rng: np.random.Generator) -> None:
    changes: list[Change] = []
    store.pyramid.listen(changes.append)
    put_patch(store, rng, (1.0, 1.0, 2.0, 2.0), 1)
    cells(store, tile_at(17, 1.0, 1.0))
    put_patch(store, rng, (30.0, 1.0, 31.0, 2.0), 2)
    store.pyramid.sync()
    near, far = tile_at(17, 30.5, 1.5), tile_at(17, 1.5, 1.5)
    keys = [("site", t.z, t.x, t.y) for t in (near, far)] + [("other", near.z, near.x, near.y)]
    assert touched(keys, changes[-1]) == keys[:1]
    above = ("site", near.z, near.x, near.y - 1)
    assert touched([above], Change("site", (30.0, 1.0, 31.0, 25.55))) == []
    assert touched([above], Change("site", (30.0, 1.0, 31.0, 25.55)), margin_cells=1) == [above]


@pytest.mark.req("CDFF-SUP-181")
def test_a_corrected_frame_moves_its_patches_from_tile_to_tile(store: Store, rng: np.random.Generator) -> None:
    def anchor(x_m: float) -> None:
        store.frames.set("mana/odom", "site", UncertainTransform(se3.transform(np.eye(3), [x_m, 0.0, 0.0])))

    anchor(1.0)
    put_patch(store, rng, (0.0, 1.0, 2.0, 3.0), 1, frame="mana/odom")
    here, there = tile_at(17, 2.0, 2.0), tile_at(17, 106.0, 2.0)
    assert cells(store, here).count.sum() == pytest.approx(3000)
    assert not cells(store, there).observed.any()
    anchor(105.0)
    assert not cells(store, here).observed.any()
    assert cells(store, there).count.sum() == pytest.approx(3000)


def test_tiles_are_found_again_after_an_orderly_end_and_made_again_after_another(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    url = f"sqlite:///{tmp_path}/data"
    tile = Tile(0, 0, 0)
    with open_store(url, ManualClock(S)) as store:
        points = crowd(store, rng)
        cells(store, tile)
    files = sorted((tmp_path / "data" / "tiles").rglob("*.tile"))
    assert files
    for damaged in files:  # a flipped bit is noticed, and the tile made again
        data = bytearray(damaged.read_bytes())
        data[100] ^= 1
        damaged.write_bytes(data)
    with open_store(url, ManualClock(S)) as store:
        assert_equal_to_points(store, tile, points)
    (tmp_path / "data" / "tiles" / "closed.json").unlink()
    with open_store(url, ManualClock(S)) as store:
        assert not list((tmp_path / "data").rglob("*.tile"))
        assert_equal_to_points(store, tile, points)


def test_what_came_after_an_orderly_end_counts(tmp_path: Path, rng: np.random.Generator) -> None:
    url = f"sqlite:///{tmp_path}/data"
    with open_store(url, ManualClock(S)) as store:
        points = crowd(store, rng)
        cells(store, Tile(0, 0, 0))
    with open_store(url, ManualClock(S)) as store:
        _, more = put_patch(store, rng, (8.0, 8.0, 12.0, 12.0), 900)
        assert_equal_to_points(store, Tile(0, 0, 0), np.vstack([points, more]))

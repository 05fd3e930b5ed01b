# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tiles are equal to the statistics of the points at every level, also after changes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import InputError, OverloadedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster import CellStatistics
from cdff_common.raster.tiles import (
    HALF_SIDE_M,
    LAST_LEVEL,
    Tile,
    cell_m,
    level_of,
    tile_matrix_set,
    tiles_over,
)
from dpm_store import Store, open_store
from dpm_store.maps.patches import Patches
from dpm_store.maps.tile_changes import Change, tiles_of_change
from dpm_store.maps.tile_queries import FEW
from dpm_store.products.records import ProductRecord
from tests.support.map_products import S, new_product_of, patch, put_patch


def tile_at(z: int, x_m: float, y_m: float) -> Tile:
    columns, rows = tiles_over(z, (x_m, y_m, x_m, y_m))
    return Tile(z, columns[0], rows[0])


def cells(store: Store, tile: Tile, margin: int = 0) -> CellStatistics:
    return store.pyramid.statistics("site", tile.z, tile.geometry("site", margin))


def assert_equal_to_points(store: Store, tile: Tile, points: np.ndarray, margin: int = 0) -> None:
    result = cells(store, tile, margin)
    direct = CellStatistics.from_points(tile.geometry("site", margin), points, stamps_ns=0)
    for name in ("count", "mean", "m2"):
        np.testing.assert_allclose(
            getattr(result, name), getattr(direct, name), rtol=3e-4, atol=2e-5, err_msg=name
        )


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
def test_tiles_of_few_patches_are_assembled_at_every_level(store: Store, rng: np.random.Generator) -> None:
    points = np.vstack([put_patch(store, rng, (i, 1.0, i + 3.0, 4.0), i + 1)[1] for i in range(4)])
    for z in (17, 16, 12, 0):
        assert_equal_to_points(store, tile_at(z, 1.0, 1.0), points)
    assert not cells(store, tile_at(18, 1.0, 1.0)).observed.any()  # patches of 10 cm have no finer tiles
    assert not cells(store, tile_at(17, 500.0, 1.0)).observed.any()


def put_many_patches(store: Store, rng: np.random.Generator, count: int = FEW + 20) -> np.ndarray:
    """Insert more patches, of 20 cm, than a tile assembles directly, and return their points."""
    corners = rng.uniform(-20.0, 60.0, (count, 2))
    result = [
        patch(rng, (x, y, x + 6.0, y + 6.0), seq, cell_m=0.2, n=1500) for seq, (x, y) in enumerate(corners, 1)
    ]
    store.put_all(
        [new_product_of(value, "dem", seq, resolution_m=0.2) for seq, (value, _) in enumerate(result, 1)]
    )
    return np.vstack([points for _, points in result])


@pytest.mark.parametrize("margin", [0, 1])
def test_many_patches_are_aggregated_from_level_to_level(
    store: Store, rng: np.random.Generator, margin: int
) -> None:
    points = put_many_patches(store, rng)
    for z in (16, 15, 14, 10, 0):
        assert_equal_to_points(store, tile_at(z, 10.0, 10.0), points, margin)


def test_coarse_patches_count_at_their_own_levels(store: Store, rng: np.random.Generator) -> None:
    fine = put_many_patches(store, rng)
    _, coarse = put_patch(store, rng, (-16.0, -16.0, 48.0, 48.0), 500, cell_m=0.8, n=20_000)
    assert_equal_to_points(store, tile_at(15, 10.0, 10.0), fine)
    for z in (14, 12, 0):
        assert_equal_to_points(store, tile_at(z, 10.0, 10.0), np.vstack([fine, coarse]))


@pytest.mark.req("CDFF-SUP-181")
def test_insertions_and_deletions_change_tiles_at_every_level(store: Store, rng: np.random.Generator) -> None:
    points = put_many_patches(store, rng)
    tiles = [tile_at(z, 10.0, 10.0) for z in (16, 14, 0)]
    for tile in tiles:
        cells(store, tile)
    new_id, more = put_patch(store, rng, (8.0, 8.0, 12.0, 12.0), 900)
    for tile in tiles:
        assert_equal_to_points(store, tile, np.vstack([points, more]))
    store.delete(new_id)
    for tile in tiles:
        assert_equal_to_points(store, tile, points)


def test_only_new_patches_are_read_after_an_insertion(
    store: Store, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = [put_many_patches(store, rng)]
    tiles = [tile_at(z, 10.0, 10.0) for z in (14, 0)]
    for tile in tiles:
        cells(store, tile)
    read, read_patches = [], Patches.read

    def record(patches: Patches, records: Sequence[ProductRecord]) -> Any:
        read.extend(r.id for r in records)
        return read_patches(patches, records)

    monkeypatch.setattr(Patches, "read", record)
    new_ids = []
    for seq in (900, 901):
        new_id, more = put_patch(store, rng, (8.0, 8.0, 12.0, 12.0), seq)
        new_ids.append(new_id)
        points.append(more)
    for tile in tiles:
        assert_equal_to_points(store, tile, np.vstack(points))
        cells(store, tile)
    assert sorted(read) == sorted(2 * new_ids)


def test_patches_inserted_while_a_tile_is_pooled_are_added_once(
    store: Store, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = put_many_patches(store, rng)
    more: list[np.ndarray] = []
    read_patches = Patches.read

    def insert_and_read(patches: Patches, records: Sequence[ProductRecord]) -> Any:
        if len(more) < 20:
            x, y = rng.uniform(0.0, 50.0, 2)
            more.append(put_patch(store, rng, (x, y, x + 4.0, y + 4.0), 900 + len(more))[1])
        return read_patches(patches, records)

    monkeypatch.setattr(Patches, "read", insert_and_read)
    tile = tile_at(0, 10.0, 10.0)
    assert_equal_to_points(store, tile, before)
    assert len(more) > 10
    monkeypatch.undo()
    for z in (14, 0):
        assert_equal_to_points(store, tile_at(z, 10.0, 10.0), np.vstack([before, *more]))


def test_a_request_is_refused_if_others_pool_tiles_for_too_long(
    store: Store, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dpm_store.maps.pyramid._WAIT_S", 0.05)
    put_patch(store, rng, (1.0, 1.0, 2.0, 2.0), 1)

    def other_requests() -> None:
        with ThreadPoolExecutor(1) as pool:
            with pytest.raises(OverloadedError, match=r"for 0\.05 s"):
                pool.submit(cells, store, tile_at(17, 1.0, 1.0)).result()
            with pytest.raises(OverloadedError, match=r"for 0\.05 s"):
                pool.submit(store.pyramid.sync).result()

    put_patch(store, rng, (1.0, 1.0, 2.0, 2.0), 2)
    put_third = partial(put_patch, store, rng, (1.0, 1.0, 2.0, 2.0), 3)
    with ExitStack() as first_call:
        first_call.callback(other_requests)
        first_call.callback(put_third)
        store.pyramid.without_changes("site", first_call.close)


def test_a_change_invalidates_only_the_tiles_that_it_overlaps(store: Store, rng: np.random.Generator) -> None:
    changes: list[Change] = []
    store.pyramid.listen(changes.append)
    put_patch(store, rng, (1.0, 1.0, 2.0, 2.0), 1)
    cells(store, tile_at(17, 1.0, 1.0))
    put_patch(store, rng, (30.0, 1.0, 31.0, 2.0), 2)
    store.pyramid.sync()
    near, far = tile_at(17, 30.5, 1.5), tile_at(17, 1.5, 1.5)
    keys = [("site", t.z, t.x, t.y) for t in (near, far)] + [("other", near.z, near.x, near.y)]
    assert tiles_of_change(keys, changes[-1]) == keys[:1]
    above = ("site", near.z, near.x, near.y - 1)
    assert tiles_of_change([above], Change("site", (30.0, 1.0, 31.0, 25.55))) == []
    assert tiles_of_change([above], Change("site", (30.0, 1.0, 31.0, 25.55)), margin_cells=1) == [above]


@pytest.mark.req("CDFF-SUP-181")
def test_a_corrected_frame_moves_its_patches_from_tile_to_tile(
    store: Store, rng: np.random.Generator
) -> None:
    def anchor(x_m: float) -> None:
        store.frames.set("mana/odom", "site", UncertainTransform(se3.transform(np.eye(3), [x_m, 0.0, 0.0])))

    anchor(1.0)
    put_patch(store, rng, (0.0, 1.0, 2.0, 3.0), 1, frame="mana/odom")
    old_tile, new_tile = tile_at(17, 2.0, 2.0), tile_at(17, 106.0, 2.0)
    assert cells(store, old_tile).count.sum() == pytest.approx(3000)
    assert not cells(store, new_tile).observed.any()
    anchor(105.0)
    assert not cells(store, old_tile).observed.any()
    assert cells(store, new_tile).count.sum() == pytest.approx(3000)


@pytest.mark.slow
@pytest.mark.parametrize("is_deleted_first", [True, False])
def test_a_map_that_was_moved_and_deleted_leaves_no_tile(
    store: Store, rng: np.random.Generator, is_deleted_first: bool
) -> None:
    def anchor(x_m: float) -> None:
        store.frames.set("mana/odom", "site", UncertainTransform(se3.transform(np.eye(3), [x_m, 0.0, 0.0])))

    anchor(0.0)
    points = put_many_patches(store, rng)
    moved_id, _ = put_patch(store, rng, (8.0, 8.0, 12.0, 12.0), 900, frame="mana/odom")
    cells(store, Tile(0, 0, 0))
    for step in (store.delete, anchor) if is_deleted_first else (anchor, store.delete):
        step(500.0 if step is anchor else moved_id)  # type: ignore[arg-type]
    assert_equal_to_points(store, tile_at(14, 10.0, 10.0), points)
    assert_equal_to_points(store, Tile(0, 0, 0), points)


def test_another_covariance_of_a_frame_changes_its_tiles(store: Store, rng: np.random.Generator) -> None:
    def anchor(sigma_m: float) -> None:
        covariance = np.diag([sigma_m**2] * 3 + [0.0] * 3)
        store.frames.set("mana/odom", "site", UncertainTransform(np.eye(4), covariance))

    anchor(0.01)
    for seq in range(FEW + 1):
        put_patch(store, rng, (1.0, 1.0, 2.0, 2.0), seq + 1, frame="mana/odom")
    tile = tile_at(17, 1.5, 1.5)
    before = np.nanmax(cells(store, tile).to_layers(0)["variance"])
    anchor(0.5)
    assert np.nanmax(cells(store, tile).to_layers(0)["variance"]) > before


@pytest.mark.slow
def test_tile_files_are_reused_after_closing_and_discarded_after_a_crash(
    tmp_path: Path, new_store: Callable[[Path], str], rng: np.random.Generator
) -> None:
    url = new_store(tmp_path / "data")
    tile = Tile(0, 0, 0)
    with open_store(url, ManualClock(S)) as store:
        points = put_many_patches(store, rng)
        cells(store, tile)
    files = sorted((tmp_path / "data" / "tiles").rglob("*.tile"))
    assert files
    for damaged in files:  # a corrupt tile is detected and computed again
        data = bytearray(damaged.read_bytes())
        data[100] ^= 1
        damaged.write_bytes(data)
    with open_store(url, ManualClock(S)) as store:
        assert_equal_to_points(store, tile, points)
    (tmp_path / "data" / "tiles" / "closed.json").unlink()
    with open_store(url, ManualClock(S)) as store:
        assert not list((tmp_path / "data").rglob("*.tile"))
        assert_equal_to_points(store, tile, points)


@pytest.mark.slow
def test_changes_after_closing_are_applied_to_tile_files(
    tmp_path: Path, new_store: Callable[[Path], str], rng: np.random.Generator
) -> None:
    url = new_store(tmp_path / "data")
    with open_store(url, ManualClock(S)) as store:
        points = put_many_patches(store, rng)
        cells(store, Tile(0, 0, 0))
    with open_store(url, ManualClock(S)) as store:
        _, more = put_patch(store, rng, (8.0, 8.0, 12.0, 12.0), 900)
        assert_equal_to_points(store, Tile(0, 0, 0), np.vstack([points, more]))
        _, last = put_patch(store, rng, (8.0, 8.0, 12.0, 12.0), 901)
        store.pyramid.sync()  # the files of the tile do not have the last patch
    with open_store(url, ManualClock(S)) as store:
        assert_equal_to_points(store, Tile(0, 0, 0), np.vstack([points, more, last]))


def test_a_map_inserted_during_the_last_synchronisation_is_added_after_closing(
    tmp_path: Path, new_store: Callable[[Path], str], rng: np.random.Generator
) -> None:
    url = new_store(tmp_path / "data")
    points: list[np.ndarray] = []
    with open_store(url, ManualClock(S)) as store:
        points.append(put_many_patches(store, rng))
        cells(store, Tile(0, 0, 0))

        def insert_during_synchronisation(_: Change) -> None:
            if len(points) == 2:
                points.append(put_patch(store, rng, (30.0, 8.0, 34.0, 12.0), 901)[1])

        store.pyramid.listen(insert_during_synchronisation)
        points.append(put_patch(store, rng, (500.0, 8.0, 504.0, 12.0), 900)[1])
        store.pyramid.sync()
    with open_store(url, ManualClock(S)) as store:
        assert_equal_to_points(store, tile_at(14, 30.0, 10.0), np.vstack(points))
        assert_equal_to_points(store, Tile(0, 0, 0), np.vstack(points))

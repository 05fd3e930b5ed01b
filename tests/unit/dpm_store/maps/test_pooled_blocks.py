# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Windows from blocks of pooled cells equal windows from patches, after every kind of change."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cdff_common.errors import OverloadedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import parse_region
from cdff_common.raster.cell_selection import Choice, Disagreement
from dpm_store import Store
from dpm_store.engine.time_limit import time_limit
from dpm_store.maps import pooled_blocks
from dpm_store.maps.patches import Patches
from dpm_store.maps.windows import Window, WindowQuery
from tests.support.map_products import S, put_patch, put_patch_with_all_layers

REGION = parse_region("bbox:-3.3,-2.1,14.7,9.9")
RULES = [
    {},
    {"choice": Choice.NEWEST},
    {"choice": Choice.WEIGHTED},
    {"disagreement": Disagreement.DROP},
    {"disagreement": Disagreement.NEWEST},
    {"robot": "mana"},
    {"resolution_m": 0.25},
]


@pytest.fixture
def read_counts(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Number of patches of each reading."""
    counts: list[int] = []
    read = Patches.read

    def counted(self: Patches, records: list) -> object:  # type: ignore[type-arg]
        counts.append(len(records))
        return read(self, records)

    monkeypatch.setattr(Patches, "read", counted)
    return counts


def without_blocks(store: Store, query: WindowQuery, monkeypatch: pytest.MonkeyPatch) -> Window:
    """Return the window that is assembled from its patches."""
    with monkeypatch.context() as patched:
        patched.setattr(pooled_blocks, "WINDOW_BYTES", 0)
        return store.maps.elevation_window(query)


def put_patches(store: Store, rng: np.random.Generator, first: int, count: int) -> list[str]:
    ids = []
    for seq in range(first, first + count):
        x, y = rng.uniform(-3.0, 12.0), rng.uniform(-2.0, 8.0)
        put = put_patch_with_all_layers if seq % 2 else put_patch
        put(store, rng, (x, y, x + 3.0, y + 2.0), seq, "minnie" if seq % 3 == 0 else "mana")
        ids += [r.id for r in store.search().items if r.t1_ns == seq * S]
    return ids


def assert_equal(window: Window, expected: Window) -> None:
    assert window.map.layer_names == expected.map.layer_names
    for name in expected.map.layer_names:
        np.testing.assert_allclose(
            window.map.layer(name), expected.map.layer(name), rtol=1e-5, atol=1e-6, err_msg=name
        )
    assert window.header == expected.header
    assert window.manifest() == expected.manifest()


@pytest.mark.parametrize("rules", RULES)
def test_windows_from_blocks_equal_windows_from_patches_after_insertions_and_deletions(
    store: Store, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, rules: dict[str, object]
) -> None:
    query = replace(WindowQuery(REGION), **rules)  # type: ignore[arg-type]
    ids = put_patches(store, rng, 1, 12)
    for change in (lambda: None, lambda: put_patches(store, rng, 13, 3), lambda: store.delete(ids[4])):
        change()
        expected = without_blocks(store, query, monkeypatch)
        for _ in range(2):
            assert_equal(store.maps.elevation_window(query), expected)


def test_a_repeated_window_reads_only_the_patches_inserted_since(
    store: Store, rng: np.random.Generator, read_counts: list[int]
) -> None:
    put_patches(store, rng, 1, 12)
    store.maps.elevation_window(WindowQuery(REGION))
    store.maps.elevation_window(WindowQuery(parse_region("bbox:0,0,5,5"), resolution_m=0.1))
    put_patches(store, rng, 13, 2)
    store.maps.elevation_window(WindowQuery(REGION))
    assert read_counts == [12, 0, 2]


def test_blocks_follow_a_frame_that_moves(
    store: Store, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    query = WindowQuery(REGION)
    put_patch(store, rng, (0.0, 0.0, 2.0, 2.0), 1)
    for dx_m, sigma_m in ((0.0, 0.0), (3.0, 0.0), (3.0, 0.1)):
        T = se3.transform(np.eye(3), [dx_m, 0.0, 0.0])
        store.frames.set("mana/odom", "site", UncertainTransform(T, np.eye(6) * sigma_m**2))
        if dx_m == 0.0:
            put_patch(store, rng, (4.0, 0.0, 6.0, 2.0), 2, frame="mana/odom")
        window = store.maps.elevation_window(query)
        assert_equal(window, without_blocks(store, query, monkeypatch))
        assert window.resampled == {"mana/odom": 1}


def test_an_earlier_state_uses_no_blocks(
    store: Store, rng: np.random.Generator, read_counts: list[int]
) -> None:
    put_patches(store, rng, 1, 4)
    for _ in range(2):
        store.maps.elevation_window(WindowQuery(REGION, t1_ns=3 * S))
    assert read_counts == [3, 3]


def test_coarser_patches_beside_a_window_are_not_pooled_in_its_blocks(
    store: Store, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_patch(store, rng, (0.0, 0.0, 2.0, 2.0), 1)
    put_patch(store, rng, (8.0, 0.0, 10.0, 2.0), 2, cell_m=0.4)
    fine = WindowQuery(parse_region("bbox:0,0,2,2"))
    assert store.maps.elevation_window(fine).map.geometry.resolution_m == pytest.approx(0.1)
    for query in (fine, WindowQuery(REGION)):
        assert_equal(store.maps.elevation_window(query), without_blocks(store, query, monkeypatch))


def test_patches_read_before_the_time_was_over_stay_in_the_blocks(
    store: Store, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, read_counts: list[int]
) -> None:
    monkeypatch.setattr("dpm_store.maps.patches._BATCH", 2)
    put_patches(store, rng, 1, 10)
    checks = iter([None, None, OverloadedError("6 patches left")])

    def check_time(*_: object) -> None:
        error = next(checks, None)
        if error is not None:
            raise error

    with monkeypatch.context() as patched, time_limit(1.0):
        patched.setattr("dpm_store.maps.patches.check_time", check_time)
        with pytest.raises(OverloadedError, match="left"):
            store.maps.elevation_window(WindowQuery(REGION))
    window = store.maps.elevation_window(WindowQuery(REGION))
    assert read_counts == [10, 6]
    assert_equal(window, without_blocks(store, WindowQuery(REGION), monkeypatch))


def test_dropped_blocks_are_pooled_again(
    store: Store, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, read_counts: list[int]
) -> None:
    monkeypatch.setattr(pooled_blocks, "CACHE_BYTES", 2 << 20)  # one block
    put_patches(store, rng, 1, 6)
    windows = [store.maps.elevation_window(WindowQuery(REGION)) for _ in range(2)]
    assert read_counts == [6, 6]
    assert_equal(windows[1], windows[0])


def test_idle_blocks_are_dropped(
    store: Store, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch, read_counts: list[int]
) -> None:
    now_s = [100.0]
    monkeypatch.setattr(pooled_blocks, "monotonic_s", lambda: now_s[0])
    put_patches(store, rng, 1, 6)
    expected = store.maps.elevation_window(WindowQuery(REGION))
    now_s[0] += pooled_blocks.IDLE_S - 1.0
    near = WindowQuery(parse_region("bbox:0,0,1,1"))
    store.maps.elevation_window(near)
    now_s[0] += 2.0
    store.maps.drop_idle_blocks()
    store.maps.elevation_window(near)
    assert sum(read_counts) == 6  # the blocks of the second window are kept
    now_s[0] += pooled_blocks.IDLE_S
    assert not store.maps.drop_idle_blocks()
    now_s[0] += 1.0
    assert store.maps.drop_idle_blocks()
    assert not store.maps.drop_idle_blocks()
    assert_equal(store.maps.elevation_window(WindowQuery(REGION)), expected)
    assert sum(read_counts) == 12


def test_windows_at_once_have_every_patch_once(
    store: Store, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_patches(store, rng, 1, 20)
    regions = ["bbox:-3.3,-2.1,14.7,9.9", "bbox:0,0,6,6", "bbox:4,-2,14,5", "circle:5,3,4"]
    queries = [WindowQuery(parse_region(region)) for region in regions]
    windows: dict[int, Window] = {}

    def assemble(number: int) -> Callable[[], None]:
        return lambda: windows.__setitem__(number, store.maps.elevation_window(queries[number % 4]))

    threads = [threading.Thread(target=assemble(number)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for number in range(8):
        if number % 4 < 3:  # at the edge of a circle, blocks have more neighbouring cells than its patches
            assert_equal(windows[number], without_blocks(store, queries[number % 4], monkeypatch))
    assert len({windows[n].header.id for n in range(8)}) == 4


def test_a_window_waits_for_the_blocks_of_another_a_limited_time(
    store: Store, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    put_patches(store, rng, 1, 3)
    expected = store.maps.elevation_window(WindowQuery(REGION))
    monkeypatch.setattr(pooled_blocks, "_WAIT_S", 0.05)
    block = next(iter(store.maps._blocks._blocks.values()))
    with block.lock, pytest.raises(OverloadedError, match="have pooled the same maps"):
        store.maps.elevation_window(WindowQuery(REGION))
    assert_equal(store.maps.elevation_window(WindowQuery(REGION)), expected)

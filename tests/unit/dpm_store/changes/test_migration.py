# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A store is copied to another engine with its history, while it is written and after an interruption."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import ConfigurationError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.region import parse_region
from dpm_store import Query, Store, open_store
from dpm_store.changes import migration
from dpm_store.changes.migration import copy_store
from dpm_store.payloads.payloads import PACKED_BYTES
from tests.support.store_products import header, put

S = 1_000_000_000
EVERYWHERE = parse_region("bbox:-1000,-1000,1000,1000")


def payload(seq: int) -> bytes:
    return np.random.default_rng(seq).bytes(PACKED_BYTES + 1 if seq % 3 == 0 else 50 + seq)


def fill(store: Store, clock: ManualClock, first: int = 0) -> None:
    """Insert, annotate, delete, purge and collect products, and move their frame."""
    for seq in range(first, first + 20):
        clock.set_ns(clock.now_ns() + S)
        put(store, header(seq, box_m=(seq, 0, 0, seq + 1, 1, 1), frame="mana/odom"), payload(seq))
    store.annotations.update(header(first + 3).id, {"tags": ["kept"], "pinned": True}, if_match=0)
    clock.set_ns(clock.now_ns() + S)
    store.frames.set("mana/odom", "site", UncertainTransform(se3.transform(np.eye(3), [first, 0, 0])))
    for seq in (first + 5, first + 6, first + 7):
        store.delete(header(seq).id)
    store.purge(header(first + 6).id)
    store.collect()
    store.write_note("clock", {"ns": first})


def state(store: Store, as_of_ns: int | None = None) -> list[tuple[int, bytes]]:
    """Return the products of a region at a time, with their payloads if it is now."""
    frame = "site" if as_of_ns is None else "mana/odom"  # which has no parent yet
    page = store.search(Query(region=EVERYWHERE, frame=frame, limit=1000, as_of_ns=as_of_ns))
    return [(r.header.seq, b"" if as_of_ns is not None else store.payload(r.id)) for r in page.items]


@pytest.fixture
def source(tmp_path: Path, clock: ManualClock, empty: Path) -> Store:
    opened = open_store(f"sqlite:///{tmp_path}/source", clock)
    fill(opened, clock)
    return opened


def test_a_store_in_use_is_copied_with_its_history(
    source: Store, clock: ManualClock, tmp_path: Path, new_store: Callable[[Path], str]
) -> None:
    middle_ns = clock.now_ns() - 8 * S
    with source, open_store(new_store(tmp_path / "copy"), clock) as copy:
        result = copy_store(source.url, copy)
        assert (result.problems, result.lost, result.products) == ([], [], 17)
        assert copy.events.since() == source.events.since()
        assert state(copy) == state(source)
        assert state(copy, middle_ns) == state(source, middle_ns) != []
        assert copy.annotations.history(header(3).id) == source.annotations.history(header(3).id)
        assert copy.read_note("clock") == {"ns": 0}
        # later changes are copied by the next call
        fill(source, clock, 100)
        result = copy_store(source.url, copy)
        assert (result.problems, result.products) == ([], 34)
        assert state(copy) == state(source)
        assert copy.read_note("clock") == {"ns": 100}


def test_an_interrupted_copy_continues(
    source: Store,
    clock: ManualClock,
    tmp_path: Path,
    new_store: Callable[[Path], str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(migration, "_BATCH", 7)

    def interrupt(last: int, _newest: int) -> None:
        if last == 14:
            raise KeyboardInterrupt

    url = new_store(tmp_path / "copy")
    with source:
        with open_store(url, clock) as copy, pytest.raises(KeyboardInterrupt):
            copy_store(source.url, copy, interrupt)
        with open_store(url, clock) as copy:
            assert copy.events.last_ordinal() == 14
            result = copy_store(source.url, copy)
            assert (result.problems, result.changes) == ([], source.events.last_ordinal() - 14)
            assert state(copy) == state(source)


def test_a_store_with_other_products_is_refused(
    source: Store, clock: ManualClock, tmp_path: Path, new_store: Callable[[Path], str]
) -> None:
    with source, open_store(new_store(tmp_path / "copy"), clock) as other:
        put(other, header(500))
        with pytest.raises(ConfigurationError, match=r"1 changes.*expected an empty store"):
            copy_store(source.url, other)


def test_without_a_source_nothing_is_created(store: Store, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="there is no store"):
        copy_store(f"sqlite:///{tmp_path}/nowhere", store)
    assert not (tmp_path / "nowhere").exists()


def test_a_live_product_whose_payload_is_damaged_is_reported(
    source: Store, clock: ManualClock, tmp_path: Path, new_store: Callable[[Path], str]
) -> None:
    with source, open_store(new_store(tmp_path / "copy"), clock) as copy:
        (path,) = [p for p in (source.directory / "blobs").glob("??/*") if p.read_bytes() == payload(9)]
        path.write_bytes(b"damaged")
        result = copy_store(source.url, copy)
        assert (result.lost, result.products) == ([header(9).id], 16)

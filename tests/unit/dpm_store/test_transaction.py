# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Several changes at once, and the purge of one product."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConflictError, InputError, ProductNotFoundError, StorageError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import parse_region
from dpm_store import Parcel, Query, StaleRevisionError, Store
from dpm_store.payloads import PACKED_BYTES
from dpm_store.transaction import Change, Delete, Insert, Reanchor, Update

from .conftest import NAMES, header, put


def parcel(seq: int, payload: bytes = b"payload", **fields: Any) -> Parcel:
    return Parcel(header(seq, **fields), payload, **NAMES)


def shift(x_m: float) -> UncertainTransform:
    matrix = np.eye(4)
    matrix[0, 3] = x_m
    return UncertainTransform(matrix)


@pytest.mark.req("CDFF-SUP-083")
def test_a_mixed_transaction_makes_every_change_in_order(store: Store) -> None:
    for seq in (1, 2, 3):
        put(store, header(seq, frame="mana/odom", box_m=(0, 0, 0, 1, 1, 1)))
    store.frames.set("mana/odom", "site", shift(0.0))
    changes: list[Change] = [
        Insert(parcel(9, frame="mana/odom", box_m=(0, 0, 0, 1, 1, 1))),
        Update(header(1).id, {"superseded_by": header(9).id}, if_match=0, author="anna"),
        Update(header(9).id, {"pinned": True, "tags": ["better"]}),
        Delete(header(2).id, if_match=0),
        Reanchor("mana/odom", "site", shift(50.0), {"expected_revision": 1, "producer": "loop closure"}),
    ]
    outcomes = store.transact(changes)
    assert [type(outcome).__name__ for outcome in outcomes] == [
        "Insertion", "Annotation", "Annotation", "bool", "FrameRevision",
    ]  # fmt: skip
    moved = Query(region=parse_region("bbox:49,0,52,1"), superseded=False)
    assert [r.header.seq for r in store.search(moved).items] == [9, 3]
    kinds = [e.kind for e in store.events.since()][4:]
    assert kinds == ["inserted", "updated", "updated", "deleted", "reanchored"]


LAST: dict[str, tuple[Change, type[Exception]]] = {
    "a stale revision": (Update(header(1).id, {"pinned": True}, if_match=7), StaleRevisionError),
    "a deletion of another revision": (Delete(header(1).id, if_match=7), StaleRevisionError),
    "an unknown product": (Delete("f" * 36), ProductNotFoundError),
    "other content of an id": (Insert(parcel(1, b"other")), ConflictError),
    "a loop of frames": (Reanchor("site", "mana/odom", shift(1.0)), InputError),
    "a stale frame": (Reanchor("mana/odom", "site", shift(1.0), {"expected_revision": 7}), ConflictError),
}


@pytest.mark.parametrize("why", LAST)
@pytest.mark.req("CDFF-SUP-083")
def test_of_a_transaction_that_fails_nothing_is_left(store: Store, why: str) -> None:
    put(store, header(1))
    store.frames.set("mana/odom", "site", shift(0.0))
    before = store.events.last_ordinal()
    change, error = LAST[why]
    first: list[Change] = [
        Insert(parcel(5, b"x" * (PACKED_BYTES + 1))), Update(header(1).id, {"tags": ["a"]}),
        Reanchor("mana/odom", "site", shift(2.0)),
    ]  # fmt: skip
    with pytest.raises(error):
        store.transact([*first, change])
    assert store.events.last_ordinal() == before
    assert store.annotations.get(header(1).id).revision == 0
    assert store.frames.lookup("site", "mana/odom").matrix[0, 3] == 0.0
    assert [r.header.seq for r in store.search().items] == [1]
    assert store.verify() == ()


def test_a_transaction_holds_one_change_at_least(store: Store) -> None:
    with pytest.raises(InputError, match="0 changes"):
        store.transact([])


def test_a_purge_frees_the_payload_and_keeps_what_was_known(store: Store) -> None:
    for seq, size in ((1, 100), (2, PACKED_BYTES + 1)):
        put(store, header(seq), bytes([seq]) * size)
        with pytest.raises(ConflictError, match="delete it first"):
            store.purge(header(seq).id)
        store.delete(header(seq).id)
        assert store.purge(header(seq).id) == size
        assert store.purge(header(seq).id) == 0
        assert store.get(header(seq).id, deleted=True).size == size
        with pytest.raises(ConflictError, match="was deleted"):
            put(store, header(seq), bytes([seq]) * size)
    assert [e.body["id"] for e in store.events.since(kind="purged")] == [header(1).id, header(2).id]
    assert store.verify() == ()


@pytest.mark.parametrize("size", [10, PACKED_BYTES + 1])
def test_a_purge_leaves_what_another_product_holds_too(store: Store, size: int) -> None:
    for seq in (1, 2):
        put(store, header(seq), b"s" * size)
    store.delete(header(1).id)
    assert store.purge(header(1).id) == 0
    assert store.payload(header(2).id) == b"s" * size
    assert store.verify() == ()


def test_a_purge_of_what_was_never_there_is_refused(store: Store) -> None:
    with pytest.raises(ProductNotFoundError):
        store.purge("f" * 36)


def test_a_payload_that_was_purged_cannot_be_read(store: Store) -> None:
    put(store, header(1))
    store.delete(header(1).id)
    store.purge(header(1).id)
    with pytest.raises((ProductNotFoundError, StorageError)):
        store.payload(header(1).id)

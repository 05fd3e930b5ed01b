# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transactions of several changes, and the purge of a product."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConflictError, InputError, ProductNotFoundError, StorageError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import parse_region
from dpm_store import NewProduct, Query, StaleRevisionError, Store
from dpm_store.payloads.payloads import PACKED_BYTES
from dpm_store.products.transaction import Change, Delete, Reanchor, Update
from tests.support.store_products import NAMES, header, put


def new_product(seq: int, payload: bytes = b"payload", **fields: Any) -> NewProduct:
    return NewProduct(header(seq, **fields), payload, **NAMES)


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
        new_product(9, frame="mana/odom", box_m=(0, 0, 0, 1, 1, 1)),
        Update(header(1).id, {"superseded_by": header(9).id}, if_match=0, author="anna"),
        Update(header(9).id, {"pinned": True, "tags": ["better"]}),
        Delete(header(2).id, if_match=0),
        Reanchor("mana/odom", "site", shift(50.0), {"expected_revision": 1, "producer": "loop closure"}),
    ]
    outcomes = store.transact(changes)
    assert [type(outcome).__name__ for outcome in outcomes] == [
        "Insertion",
        "Annotation",
        "Annotation",
        "bool",
        "FrameRevision",
    ]
    query = Query(region=parse_region("bbox:49,0,52,1"), superseded=False)
    assert [r.header.seq for r in store.search(query).items] == [9, 3]
    kinds = [e.kind for e in store.events.since()][4:]
    assert kinds == ["inserted", "updated", "updated", "deleted", "reanchored"]


INVALID_CHANGES: dict[str, tuple[Change, type[Exception]]] = {
    "a stale revision": (Update(header(1).id, {"pinned": True}, if_match=7), StaleRevisionError),
    "a deletion of another revision": (Delete(header(1).id, if_match=7), StaleRevisionError),
    "an unknown product": (Delete("f" * 36), ProductNotFoundError),
    "other content of an id": (new_product(1, b"other"), ConflictError),
    "a loop of frames": (Reanchor("site", "mana/odom", shift(1.0)), InputError),
    "a stale frame": (Reanchor("mana/odom", "site", shift(1.0), {"expected_revision": 7}), ConflictError),
}


@pytest.mark.parametrize("case", INVALID_CHANGES)
@pytest.mark.req("CDFF-SUP-083")
def test_a_failed_transaction_changes_nothing(store: Store, case: str) -> None:
    put(store, header(1))
    store.frames.set("mana/odom", "site", shift(0.0))
    before = store.events.last_ordinal()
    change, error = INVALID_CHANGES[case]
    first: list[Change] = [
        new_product(5, b"x" * (PACKED_BYTES + 1)),
        Update(header(1).id, {"tags": ["a"]}),
        Reanchor("mana/odom", "site", shift(2.0)),
    ]
    with pytest.raises(error):
        store.transact([*first, change])
    assert store.events.last_ordinal() == before
    assert store.annotations.get(header(1).id).revision == 0
    assert store.poses.at(0, "site", "mana/odom").matrix[0, 3] == 0.0
    assert [r.header.seq for r in store.search().items] == [1]
    assert store.verify() == ()


def test_a_transaction_has_at_least_one_change(store: Store) -> None:
    with pytest.raises(InputError, match="0 changes"):
        store.transact([])


def test_a_purge_frees_the_payload_and_keeps_the_metadata(store: Store) -> None:
    for seq, size in ((1, 100), (2, PACKED_BYTES + 1)):
        payload = np.random.default_rng(seq).bytes(size)
        put(store, header(seq), payload)
        with pytest.raises(ConflictError, match="delete it first"):
            store.purge(header(seq).id)
        store.delete(header(seq).id)
        assert store.purge(header(seq).id) == size
        assert store.purge(header(seq).id) == 0
        assert store.get(header(seq).id, deleted=True).size == size
        with pytest.raises(ConflictError, match="was deleted"):
            put(store, header(seq), payload)
    assert [e.body["id"] for e in store.events.since(kind="purged")] == [header(1).id, header(2).id]
    assert store.verify() == ()


@pytest.mark.parametrize("size", [10, PACKED_BYTES + 1])
def test_a_purge_keeps_a_shared_payload(store: Store, size: int) -> None:
    for seq in (1, 2):
        put(store, header(seq), b"s" * size)
    store.delete(header(1).id)
    assert store.purge(header(1).id) == 0
    assert store.payload(header(2).id) == b"s" * size
    assert store.verify() == ()


def test_a_purge_of_an_unknown_product_is_refused(store: Store) -> None:
    with pytest.raises(ProductNotFoundError):
        store.purge("f" * 36)


def test_a_payload_that_was_purged_cannot_be_read(store: Store) -> None:
    put(store, header(1))
    store.delete(header(1).id)
    store.purge(header(1).id)
    with pytest.raises((ProductNotFoundError, StorageError)):
        store.payload(header(1).id)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import threading

import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import ConflictError, InputError, ProductNotFoundError, StorageError
from cdff_common.interfaces.product import Quality, Status
from dpm_store import Annotation, StaleRevisionError, Store
from tests.support.store_products import header, put

ID = header(0).id


@pytest.mark.req("CDFF-SUP-030")
def test_an_update_adds_a_revision_and_keeps_earlier_ones(store: Store, clock: ManualClock) -> None:
    put(store, header(0))
    assert store.annotations.get(ID) == Annotation(ID)
    first = store.annotations.update(ID, {"tags": ["b", "a", "b"], "notes": "odd"}, if_match=0, author="anna")
    before_ns = clock.now_ns()
    clock.set_ns(before_ns + 5_000_000_000)
    changes = {"pinned": True, "quality": {"status": "DEGRADED", "reasons": ["dust"]}}
    second = store.annotations.update(ID, changes, if_match=1)
    assert (first.revision, first.tags, first.author) == (1, ("a", "b"), "anna")
    assert (second.revision, second.notes, second.pinned) == (2, "odd", True)
    assert second.quality == Quality(Status.DEGRADED, ("dust",))
    assert store.annotations.get(ID) == second
    assert store.annotations.get(ID, as_of_ns=before_ns) == first
    assert store.annotations.history(ID) == (first, second)
    assert store.get(ID).header.quality.status is Status.OK
    assert store.payload(ID) == b"payload"
    assert [(e.kind, e.body.get("changed")) for e in store.events.since()][1:] == [
        ("updated", ["tags", "notes"]),
        ("updated", ["pinned", "quality"]),
    ]


def test_a_change_based_on_an_old_revision_is_refused(store: Store) -> None:
    put(store, header(0))
    store.annotations.update(ID, {"notes": "one"}, if_match=0)
    with pytest.raises(StaleRevisionError, match="revision 1"):
        store.annotations.update(ID, {"notes": "two"}, if_match=0)
    assert store.annotations.get(ID).notes == "one"
    assert store.annotations.update(ID, {"notes": "two"}, if_match=None).revision == 2


def test_an_equal_update_adds_no_revision(store: Store) -> None:
    put(store, header(0))
    first = store.annotations.update(ID, {"tags": ["a"]}, if_match=0)
    assert store.annotations.update(ID, {"tags": ["a", "a"]}, if_match=1) == first
    assert store.annotations.update(ID, {"tags": first.tags}, if_match=1) == first
    assert len(store.events.since(kind="updated")) == 1


def test_concurrent_writers_lose_no_update(store: Store) -> None:
    put(store, header(0))

    def add(name: str) -> None:
        for i in range(5):
            while True:
                current = store.annotations.get(ID)
                try:
                    store.annotations.update(
                        ID, {"tags": [*current.tags, f"{name}{i}"]}, if_match=current.revision
                    )
                except StaleRevisionError:
                    continue
                break

    threads = [threading.Thread(target=add, args=(name,)) for name in "abcdefgh"]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert store.annotations.get(ID).tags == tuple(
        sorted(f"{name}{i}" for name in "abcdefgh" for i in range(5))
    )
    assert store.annotations.get(ID).revision == 40


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"payload": b"x"},
        {"tags": "a"},
        {"tags": ["A"]},
        {"tags": ["../x"]},
        {"tags": [1]},
        {"tags": [str(i) for i in range(65)]},
        {"notes": 3},
        {"notes": "x" * 20_000},
        {"pinned": 1},
        {"quality": "good"},
        {"quality": {"status": "SUPERB"}},
        {"superseded_by": 4},
    ],
)
def test_invalid_annotations_are_refused(store: Store, changes: dict[str, object]) -> None:
    put(store, header(0))
    with pytest.raises(InputError):
        store.annotations.update(ID, changes, if_match=0)
    assert store.annotations.history(ID) == ()


def test_an_unknown_product_cannot_be_updated(store: Store) -> None:
    with pytest.raises(ProductNotFoundError):
        store.annotations.update(ID, {"notes": "x"}, if_match=0)
    put(store, header(0))
    store.delete(ID)
    with pytest.raises(ProductNotFoundError):
        store.annotations.update(ID, {"notes": "x"}, if_match=0)


def test_a_pinned_product_is_not_deleted(store: Store) -> None:
    put(store, header(0))
    store.annotations.update(ID, {"pinned": True}, if_match=0)
    with pytest.raises(ConflictError, match="pinned"):
        store.delete(ID)
    store.annotations.update(ID, {"pinned": False}, if_match=1)
    assert store.delete(ID)


def test_a_product_is_superseded_by_another_and_never_by_itself(store: Store) -> None:
    ids = [header(seq).id for seq in range(3)]
    for seq in range(3):
        put(store, header(seq))
    store.annotations.update(ids[0], {"superseded_by": ids[1]}, if_match=0)
    store.annotations.update(ids[1], {"superseded_by": ids[2]}, if_match=0)
    for wrong in (ids[0], ids[2]):
        with pytest.raises(ConflictError, match="own successor"):
            store.annotations.update(
                ids[2], {"superseded_by": wrong if wrong != ids[2] else ids[2]}, if_match=0
            )
    with pytest.raises(ProductNotFoundError):
        store.annotations.update(ids[2], {"superseded_by": header(9).id}, if_match=0)
    assert store.annotations.get(ids[0]).superseded_by == ids[1]


@pytest.mark.parametrize("statement", ["UPDATE annotations SET notes = 'x'", "DELETE FROM annotations"])
def test_annotations_are_append_only(store: Store, statement: str) -> None:
    put(store, header(0))
    store.annotations.update(ID, {"notes": "original"}, if_match=0)
    with pytest.raises(StorageError, match="append-only"), store._database.write() as connection:
        connection.exec_driver_sql(statement)
    assert store.annotations.get(ID).notes == "original"

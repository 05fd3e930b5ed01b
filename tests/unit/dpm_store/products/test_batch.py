# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import pytest

from cdff_common.errors import ConflictError, InputError, StorageError
from dpm_store import Insertion, NewProduct, Query, Store
from dpm_store.history.events import EventTable
from dpm_store.payloads.payloads import PACKED_BYTES
from dpm_store.products import products
from tests.support.store_products import NAMES, header, put


def new_products(*seqs: int) -> list[NewProduct]:
    """Products with payloads in packs and in files alternately."""
    return [NewProduct(header(seq, box_m=(0, 0, 0, 1, 1, 1)), payload(seq), **NAMES) for seq in seqs]


def payload(seq: int) -> bytes:
    return bytes([seq]) * (PACKED_BYTES + 1 if seq % 2 else 10)


@pytest.mark.req("CDFF-SUP-030")
def test_a_batch_is_stored_completely_and_in_order(store: Store) -> None:
    put(store, header(2, box_m=(0, 0, 0, 1, 1, 1)), payload(2))
    assert store.put_all(new_products(0, 1, 2, 3)) == (
        Insertion.INSERTED,
        Insertion.INSERTED,
        Insertion.ALREADY,
        Insertion.INSERTED,
    )
    assert [store.payload(header(seq).id) for seq in range(4)] == [payload(seq) for seq in range(4)]
    assert store.put_all(new_products(0, 1)) == (Insertion.ALREADY, Insertion.ALREADY)
    assert store.put_all([]) == ()
    assert store.verify() == ()


def test_a_batch_with_an_invalid_product_is_not_stored(store: Store) -> None:
    put(store, header(3), b"other content")
    before = store.events.last_ordinal()
    invalid = NewProduct(header(9), b"", **(NAMES | {"robot": "../etc"}))
    with pytest.raises(ConflictError):
        store.put_all(new_products(0, 1, 3))
    for batch in ([*new_products(0, 1), invalid], new_products(0, 1, 0)):
        with pytest.raises(InputError):
            store.put_all(batch)
    assert [record.header.seq for record in store.search(Query()).items] == [3]
    assert store.events.last_ordinal() == before


def test_a_batch_during_a_disk_failure_is_not_stored(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise StorageError("no space left")

    with monkeypatch.context() as broken:  # the last rows of the transaction
        broken.setattr(EventTable, "append_all_in", fails)
        with pytest.raises(StorageError):
            store.put_all(new_products(0, 1, 2, 3))
    assert store.statistics().count == 0
    assert store.verify() == ()
    assert store.put_all(new_products(0, 1, 2, 3)) == (Insertion.INSERTED,) * 4


def test_the_size_of_a_batch_is_limited(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(products, "MAX_BATCH", 2)
    with pytest.raises(InputError, match="at most 2"):
        store.put_all(new_products(0, 1, 2))

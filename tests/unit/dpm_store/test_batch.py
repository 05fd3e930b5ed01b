# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import pytest

from cdff_common.errors import ConflictError, InputError, StorageError
from dpm_store import Insertion, Parcel, Query, Store, products
from dpm_store.events import EventTable
from dpm_store.payloads import PACKED_BYTES

from .conftest import NAMES, header, put


def parcels(*seqs: int) -> list[Parcel]:
    """Products whose payloads lie inline and in files by turns."""
    return [Parcel(header(seq, box_m=(0, 0, 0, 1, 1, 1)), payload(seq), **NAMES) for seq in seqs]


def payload(seq: int) -> bytes:
    return bytes([seq]) * (PACKED_BYTES + 1 if seq % 2 else 10)


@pytest.mark.req("CDFF-SUP-030")
def test_a_batch_is_stored_whole_and_in_order(store: Store) -> None:
    put(store, header(2, box_m=(0, 0, 0, 1, 1, 1)), payload(2))
    assert store.put_all(parcels(0, 1, 2, 3)) == (
        Insertion.INSERTED,
        Insertion.INSERTED,
        Insertion.ALREADY,
        Insertion.INSERTED,
    )
    assert [store.payload(header(seq).id) for seq in range(4)] == [payload(seq) for seq in range(4)]
    assert store.put_all(parcels(0, 1)) == (Insertion.ALREADY, Insertion.ALREADY)
    assert store.put_all([]) == ()
    assert store.verify() == ()


def test_of_a_batch_with_one_that_cannot_be_stored_nothing_is(store: Store) -> None:
    put(store, header(3), b"other content")
    before = store.events.last_ordinal()
    bad = Parcel(header(9), b"", **(NAMES | {"robot": "../etc"}))
    with pytest.raises(ConflictError):
        store.put_all(parcels(0, 1, 3))
    for wrong in ([*parcels(0, 1), bad], parcels(0, 1, 0)):
        with pytest.raises(InputError):
            store.put_all(wrong)
    assert [record.header.seq for record in store.search(Query()).items] == [3]
    assert store.events.last_ordinal() == before


def test_of_a_batch_that_the_disk_fails_in_nothing_is_stored(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object) -> None:
        raise StorageError("no space left")

    with monkeypatch.context() as broken:  # the last rows of the transaction
        broken.setattr(EventTable, "append_all_in", fails)
        with pytest.raises(StorageError):
            store.put_all(parcels(0, 1, 2, 3))
    assert store.statistics().count == 0
    assert store.verify() == ()
    assert store.put_all(parcels(0, 1, 2, 3)) == (Insertion.INSERTED,) * 4


def test_a_batch_has_a_largest_size(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(products, "MAX_BATCH", 2)
    with pytest.raises(InputError, match="at most 2"):
        store.put_all(parcels(0, 1, 2))

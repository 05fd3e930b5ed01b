# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import os
from pathlib import Path

import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import ProductNotFoundError, StorageError
from dpm_store import Store, open_store, packs
from dpm_store.backup import backup
from dpm_store.blobs import chunk_sums
from dpm_store.packs import BLOCK_BYTES, PackFiles, merged, pack_of
from dpm_store.payloads import PACKED_BYTES

from .conftest import header, put

pytestmark = pytest.mark.req("CDFF-SUP-032")


def content(seq: int, size: int = 10_000) -> bytes:
    return seq.to_bytes(2, "big") * (size // 2)


def on_disk(store: Store) -> int:
    """Bytes that the disk holds of packs."""
    return sum(path.stat().st_blocks * 512 for path in (store.directory / "packs").iterdir())


def test_payloads_follow_each_other_and_a_full_pack_is_followed_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(packs, "PACK_BYTES", 25_000)
    payloads = [content(seq) for seq in range(7)]
    files = PackFiles(tmp_path)
    places = files.append(payloads[:5]) + files.append(payloads[5:6])
    files.settle()
    files.close()
    again = PackFiles(tmp_path)
    places += again.append(payloads[6:])
    again.settle()
    assert [pack_of(place) for place in places] == [1, 1, 1, 2, 2, 2, 3]
    for place, payload in zip(places, payloads, strict=True):
        assert again.read((place, len(payload)), chunk_sums(payload), "it") == payload
    assert merged((place, 10_000) for place in places) == [
        (places[0], 30_000), (places[3], 30_000), (places[6], 10_000),
    ]  # fmt: skip


def test_what_is_not_as_it_was_written_is_said_to_be_so(tmp_path: Path) -> None:
    files, payload = PackFiles(tmp_path), content(1)
    (place,) = files.append([payload])
    files.settle()
    os.truncate(files.path(1), 5000)
    with pytest.raises(StorageError, match="it: its pack ends at byte 5000, expected 10000"):
        files.read((place, 10_000), chunk_sums(payload), "it")
    files.path(1).unlink()
    with pytest.raises(StorageError, match="not readable"):
        files.read((place, 10_000), chunk_sums(payload), "it")


def test_what_is_collected_is_given_back_to_the_disk_and_the_rest_stays(store: Store) -> None:
    for seq in range(40):
        put(store, header(seq), content(seq))
    full = on_disk(store)
    for seq in range(40):
        if seq not in (7, 8, 39):
            store.delete(header(seq).id)
    assert store.collect() == 37 * 10_000
    assert on_disk(store) <= full - 37 * 10_000 + 6 * BLOCK_BYTES
    for seq in (7, 8, 39):
        assert store.payload(header(seq).id) == content(seq)
    assert store.verify() == ()


def test_a_purge_gives_the_disk_back_what_one_product_had(store: Store) -> None:
    for seq in range(3):
        put(store, header(seq), content(seq, PACKED_BYTES))
    full = on_disk(store)
    store.delete(header(1).id)
    assert store.purge(header(1).id) == PACKED_BYTES
    assert on_disk(store) <= full - PACKED_BYTES + 2 * BLOCK_BYTES
    assert store.payload(header(2).id) == content(2, PACKED_BYTES)


def test_what_a_crash_left_is_reclaimed_after_the_next_start(store: Store, tmp_path: Path, clock: ManualClock) -> None:
    put(store, header(0), content(0))
    store.close()
    pack = store.directory / "packs" / "00000001.pack"
    with pack.open("ab") as file:
        file.write(os.urandom(100_000))
    with open_store(f"sqlite:///{store.directory}", clock) as again:
        put(again, header(1), content(1))
        assert again.payload(header(1).id) == content(1)
        again.collect()
        assert on_disk(again) < 50_000
        assert again.verify() == ()


def test_where_the_file_system_has_no_holes_a_pack_goes_when_all_of_it_may(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(packs, "_punch", lambda *_: None)
    monkeypatch.setattr(packs, "PACK_BYTES", 25_000)
    for seq in range(7):
        put(store, header(seq), content(seq))
    for seq in range(4):
        store.delete(header(seq).id)
    store.collect()
    assert sorted(path.name for path in (store.directory / "packs").iterdir()) == ["00000002.pack", "00000003.pack"]


def test_nothing_is_taken_from_packs_while_they_are_copied(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for seq in range(4):
        put(store, header(seq), content(seq))
    real = PackFiles.copy

    def collected_before(files: PackFiles, *arguments: object) -> None:
        store.delete(header(2).id)
        assert store.collect() == 10_000
        real(files, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(PackFiles, "copy", collected_before)
    backup(store.directory, tmp_path / "copy")
    with open_store(f"sqlite:///{tmp_path}/copy") as copied:
        assert copied.payload(header(2).id) == content(2)
        assert copied.verify() == ()
    full = on_disk(store)
    store.collect()
    assert on_disk(store) < full


def test_a_payload_that_goes_while_it_is_read_is_not_found(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    put(store, header(0), content(1))
    real = PackFiles.read

    def gone_before(files: PackFiles, *arguments: object) -> bytes:
        monkeypatch.undo()
        store.delete(header(0).id)
        store.collect()
        return real(files, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(PackFiles, "read", gone_before)
    with pytest.raises(ProductNotFoundError):
        store.payload(header(0).id)


def test_a_pack_that_could_not_be_synced_is_not_added_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = PackFiles(tmp_path)
    (kept,) = files.append([content(1)])
    files.settle()

    def broken(_descriptor: int) -> None:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as failing:
        failing.setattr(os, "fdatasync", broken)
        files.append([content(2)])
        with pytest.raises(StorageError, match="10000 bytes not stored: the disk failed"):
            files.settle()
    assert files.path(1).stat().st_size == 10_000
    (place,) = files.append([content(3)])
    files.settle()
    assert pack_of(place) == 2
    assert files.read((kept, 10_000), chunk_sums(content(1)), "it") == content(1)

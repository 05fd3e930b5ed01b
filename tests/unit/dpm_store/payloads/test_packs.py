# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import os
from pathlib import Path

import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import ProductNotFoundError, StorageError
from dpm_store import Store, open_store
from dpm_store.history.backup import backup
from dpm_store.payloads import packs
from dpm_store.payloads.blobs import chunk_sums
from dpm_store.payloads.packs import BLOCK_BYTES, PackFiles, merge_spans, pack_of
from dpm_store.payloads.payloads import PACKED_BYTES
from tests.support.postgresql import ONLY_EMBEDDED, WITH_FILES
from tests.support.store_products import header, put

ENGINES = WITH_FILES

pytestmark = pytest.mark.req("CDFF-SUP-032")


def content(seq: int, size: int = 10_000) -> bytes:
    return seq.to_bytes(2, "big") * (size // 2)


def on_disk(store: Store) -> int:
    """Return the disk space in bytes that packs use."""
    return sum(path.stat().st_blocks * 512 for path in (store.directory / "packs").iterdir())


def test_payloads_are_contiguous_and_a_full_pack_is_followed_by_the_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(packs, "PACK_BYTES", 25_000)
    payloads = [content(seq) for seq in range(7)]
    files = PackFiles(tmp_path)
    offsets = files.append(payloads[:5]) + files.append(payloads[5:6])
    files.flush()
    files.close()
    reopened = PackFiles(tmp_path)
    offsets += reopened.append(payloads[6:])
    reopened.flush()
    assert [pack_of(offset) for offset in offsets] == [1, 1, 1, 2, 2, 2, 3]
    for offset, payload in zip(offsets, payloads, strict=True):
        assert reopened.read((offset, len(payload)), chunk_sums(payload), "it") == payload
    assert merge_spans((offset, 10_000) for offset in offsets) == [
        (offsets[0], 30_000),
        (offsets[3], 30_000),
        (offsets[6], 10_000),
    ]


def test_a_closed_pack_is_appended_to_again_and_its_descriptor_is_released(tmp_path: Path) -> None:
    def open_files() -> set[str]:
        return {os.path.realpath(file) for file in Path("/proc/self/fd").iterdir()}

    files = PackFiles(tmp_path)
    first = files.append([content(1)])
    files.flush()
    assert str(files.path(1).resolve()) in open_files()
    for _ in range(2):
        files.close()
        assert str(files.path(1).resolve()) not in open_files()
    second = files.append([content(2)])
    files.flush()
    files.close()
    assert second[0] == first[0] + 10_000
    assert files.numbers() == [1]
    for offset, payload in ((first[0], content(1)), (second[0], content(2))):
        assert files.read((offset, 10_000), chunk_sums(payload), "it") == payload


def test_a_truncated_or_missing_pack_is_reported(tmp_path: Path) -> None:
    files, payload = PackFiles(tmp_path), content(1)
    (offset,) = files.append([payload])
    files.flush()
    os.truncate(files.path(1), 5000)
    with pytest.raises(StorageError, match="it: its pack ends at byte 5000, expected 10000"):
        files.read((offset, 10_000), chunk_sums(payload), "it")
    files.path(1).unlink()
    with pytest.raises(StorageError, match="not readable"):
        files.read((offset, 10_000), chunk_sums(payload), "it")


def test_a_collection_frees_disk_space_and_keeps_the_rest(store: Store) -> None:
    for seq in range(40):
        put(store, header(seq), content(seq))
    full_bytes = on_disk(store)
    for seq in range(40):
        if seq not in (7, 8, 39):
            store.delete(header(seq).id)
    assert store.collect() == 37 * 10_000
    assert on_disk(store) <= full_bytes - 37 * 10_000 + 6 * BLOCK_BYTES
    for seq in (7, 8, 39):
        assert store.payload(header(seq).id) == content(seq)
    assert store.verify() == ()


def test_a_purge_frees_the_disk_space_of_one_product(store: Store) -> None:
    for seq in range(3):
        put(store, header(seq), content(seq, PACKED_BYTES))
    full_bytes = on_disk(store)
    store.delete(header(1).id)
    assert store.purge(header(1).id) == PACKED_BYTES
    assert on_disk(store) <= full_bytes - PACKED_BYTES + 2 * BLOCK_BYTES
    assert store.payload(header(2).id) == content(2, PACKED_BYTES)


def test_unreferenced_data_of_a_crash_are_reclaimed_after_the_next_start(
    store: Store, tmp_path: Path, clock: ManualClock
) -> None:
    put(store, header(0), content(0))
    store.close()
    pack = store.directory / "packs" / "00000001.pack"
    with pack.open("ab") as file:
        file.write(os.urandom(100_000))
    with open_store(store.url, clock) as reopened:
        put(reopened, header(1), content(1))
        assert reopened.payload(header(1).id) == content(1)
        reopened.collect()
        assert on_disk(reopened) < 50_000
        assert reopened.verify() == ()


def test_data_that_another_process_left_unreferenced_are_reclaimed(store: Store) -> None:
    put(store, header(0), content(0))
    store.collect()
    pack = store.directory / "packs" / "00000001.pack"
    with pack.open("ab") as file:
        file.write(os.urandom(100_000))
    store._payloads.mark_packs()
    store.collect()
    assert on_disk(store) < 50_000


def test_without_hole_punching_a_pack_is_removed_once_it_is_unreferenced(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(packs, "_punch", lambda *_: None)
    monkeypatch.setattr(packs, "PACK_BYTES", 25_000)
    for seq in range(7):
        put(store, header(seq), content(seq))
    for seq in range(4):
        store.delete(header(seq).id)
    store.collect()
    assert sorted(path.name for path in (store.directory / "packs").iterdir()) == [
        "00000002.pack",
        "00000003.pack",
    ]


@ONLY_EMBEDDED  # a server has backups of its own
def test_packs_are_not_reclaimed_while_they_are_copied(
    store: Store, engine: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for seq in range(4):
        put(store, header(seq), content(seq))
    original = PackFiles.copy

    def copy_after_collection(files: PackFiles, *arguments: object) -> None:
        store.delete(header(2).id)
        assert store.collect() == 10_000
        original(files, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(PackFiles, "copy", copy_after_collection)
    backup(store.directory, tmp_path / "copy")
    with open_store(f"sqlite:///{tmp_path}/copy") as copied:
        assert copied.payload(header(2).id) == content(2)
        assert copied.verify() == ()
    full_bytes = on_disk(store)
    store.collect()
    assert on_disk(store) < full_bytes


def test_a_payload_that_is_collected_while_it_is_read_is_not_found(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(store, header(0), content(1))
    original = PackFiles.read

    def read_after_collection(files: PackFiles, *arguments: object) -> bytes:
        monkeypatch.undo()
        store.delete(header(0).id)
        store.collect()
        return original(files, *arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(PackFiles, "read", read_after_collection)
    with pytest.raises(ProductNotFoundError):
        store.payload(header(0).id)


def test_a_pack_that_could_not_be_synced_is_not_appended_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files = PackFiles(tmp_path)
    (retained_offset,) = files.append([content(1)])
    files.flush()

    def broken(_descriptor: int) -> None:
        raise OSError(5, "Input/output error")

    with monkeypatch.context() as failing:
        failing.setattr(os, "fdatasync", broken)
        files.append([content(2)])
        with pytest.raises(StorageError, match="10000 bytes not stored: the disk failed"):
            files.flush()
    assert files.path(1).stat().st_size == 10_000
    (offset,) = files.append([content(3)])
    files.flush()
    assert pack_of(offset) == 2
    assert files.read((retained_offset, 10_000), chunk_sums(content(1)), "payload 1") == content(1)


def test_an_empty_pack_is_removed_unless_it_is_the_newest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(packs, "PACK_BYTES", 15_000)
    files = PackFiles(tmp_path)
    files.append([content(seq) for seq in range(4)])
    files.flush()
    assert files.numbers() == [1, 2]
    for number in (1, 2):
        assert files.reclaim(number, [])
    assert files.numbers() == [2]

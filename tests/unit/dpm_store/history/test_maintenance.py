# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import hashlib
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dpm_store import Insertion, Store
from dpm_store.history import maintenance
from dpm_store.payloads import blobs
from dpm_store.payloads.blobs import CHUNK_BYTES, BlobFiles, chunk_sums
from dpm_store.payloads.payloads import PACKED_BYTES
from tests.support.postgresql import ONLY_FILES
from tests.support.store_products import header, put

SMALL, LARGE = b"s" * 100, np.random.default_rng(1).bytes(PACKED_BYTES + 1)


@pytest.mark.req("CDFF-SUP-036")
def test_the_same_content_is_stored_and_counted_once(store: Store) -> None:
    for seq in range(6):
        put(store, header(seq), SMALL if seq % 2 else LARGE, robot="mana" if seq < 4 else "minnie")
    statistics = store.statistics()
    assert statistics.count == 6
    assert statistics.payload_bytes == 3 * (len(SMALL) + len(LARGE))
    assert (statistics.payloads, statistics.stored_bytes) == (2, len(SMALL) + len(LARGE))
    assert statistics.product_bytes[("minnie", "dem")] == len(SMALL) + len(LARGE)
    assert statistics.free_bytes > 0
    for seq in range(5):
        store.delete(header(seq).id)
    assert store.collect() == len(LARGE)  # product 5 still uses the small payload
    statistics = store.statistics()
    assert (statistics.count, statistics.payloads, statistics.stored_bytes) == (1, 1, len(SMALL))
    assert store.payload(header(5).id) == SMALL


@ONLY_FILES
def test_a_collection_in_steps_removes_exactly_the_unused_payloads(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(maintenance, "_WRITE_PAYLOADS", 3)
    rng = np.random.default_rng(2)
    payloads = [rng.bytes(100 if seq % 2 else PACKED_BYTES + 1) for seq in range(20)]
    for seq, payload in enumerate(payloads):
        put(store, header(seq), payload)
    orphan = store.directory / "blobs" / "ab" / ("c" * 62)
    orphan.parent.mkdir(exist_ok=True)
    orphan.write_bytes(b"x" * 7)
    for seq in range(15):
        store.delete(header(seq).id)
    assert store.collect() == 7 * 100 + 8 * (PACKED_BYTES + 1) + 7
    assert store.collect() == 0
    assert not orphan.exists()
    for seq in range(15, 20):
        assert store.payload(header(seq).id) == payloads[seq]
    assert store.verify() == ()


def test_a_collection_keeps_concurrent_insertions(store: Store) -> None:
    writer_ended = threading.Event()

    def collect() -> None:
        while not writer_ended.is_set():
            store.collect()

    collector = threading.Thread(target=collect)
    collector.start()
    try:
        for seq in range(60):  # four contents are inserted and deleted in turn
            content = bytes([seq % 4]) * (PACKED_BYTES + 1 if seq % 2 else 50)
            assert put(store, header(seq), content) is Insertion.INSERTED
            assert store.payload(header(seq).id) == content
            store.delete(header(seq).id)
    finally:
        writer_ended.set()
        collector.join()
    assert store.verify() == ()


def test_wrong_sums_and_index_entries_are_detected(store: Store, engine: str) -> None:
    put(store, header(0, box_m=(0, 0, 0, 1, 1, 1)))
    with store._database.write() as connection:
        connection.exec_driver_sql("UPDATE tallies SET live = 2")
        moved = "x0 = 8, x1 = 9" if engine == "sqlite" else "shape = ST_Translate(shape, 8, 0, 0)"
        connection.exec_driver_sql(f"UPDATE product_index SET {moved}")
    assert {p.what.split(":")[0] for p in store.verify()} == {"spatial index", "sums"}


@pytest.mark.parametrize("is_remembered", [True, False])
def test_a_payload_that_is_collected_during_an_insertion_is_written_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_remembered: bool
) -> None:
    files, payload = BlobFiles(tmp_path / "blobs"), bytes(40_000)
    digest = hashlib.sha256(payload).hexdigest()
    files.write(digest, payload, chunk_sums(payload))
    if not is_remembered:
        files = BlobFiles(tmp_path / "blobs")
    owner, name = (files, "_is_unchanged") if is_remembered else (blobs, "_has_content")
    real = getattr(owner, name)

    def collected_after(*arguments: Any) -> bool:
        has_content: bool = real(*arguments)
        assert has_content
        files.remove(digest)
        monkeypatch.undo()
        return has_content

    monkeypatch.setattr(owner, name, collected_after)
    files.write(digest, payload, chunk_sums(payload))
    assert files.read(digest, len(payload), chunk_sums(payload), 0, len(payload), "payload") == payload


def test_a_payload_written_before_files_were_compressed_is_read(tmp_path: Path) -> None:
    files, payload = BlobFiles(tmp_path), bytes(2 * CHUNK_BYTES)
    digest = hashlib.sha256(payload).hexdigest()
    files.path(digest).parent.mkdir()
    files.path(digest).write_bytes(payload)
    sums = chunk_sums(payload)
    assert files.read(digest, len(payload), sums, CHUNK_BYTES, 10, "payload") == bytes(10)
    files.write(digest, payload, chunk_sums(payload))
    assert files.path(digest).stat().st_size < 200
    assert files.read(digest, len(payload), sums, 0, len(payload), "payload") == payload

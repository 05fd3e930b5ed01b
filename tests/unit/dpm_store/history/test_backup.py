# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
import threading
from pathlib import Path

import pytest

from cdff_common.errors import ConfigurationError, StorageError
from dpm_store import Query, Store, open_store
from dpm_store.history.backup import backup
from dpm_store.payloads.payloads import PACKED_BYTES
from tests.support.store_products import header, put

#: The files are those of SQLite.
ENGINES = ("sqlite",)


def payload(seq: int) -> bytes:
    return seq.to_bytes(4, "big") * (10 if seq % 2 else PACKED_BYTES)


@pytest.mark.req("CDFF-SUP-032")
def test_a_backup_during_changes_is_complete(store: Store, tmp_path: Path) -> None:
    for seq in range(20):
        put(store, header(seq), payload(seq))
    store.annotations.update(header(3).id, {"tags": ["kept"]}, if_match=0)
    stop, seqs = threading.Event(), iter(range(20, 100_000))

    def write() -> None:
        while not stop.is_set():
            seq = next(seqs)
            put(store, header(seq), payload(seq))
            if seq % 3 == 0:
                store.delete(header(seq).id)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        result = backup(store.directory, tmp_path / "copy")
    finally:
        stop.set()
        writer.join()
    assert result.products >= 20
    backup(tmp_path / "copy", tmp_path / "restored")
    with open_store(f"sqlite:///{tmp_path}/restored") as restored:
        assert restored.verify() == ()
        assert restored.statistics().count == result.products
        assert restored.annotations.get(header(3).id).tags == ("kept",)
        for record in restored.search(Query(limit=1000)).items:
            assert restored.payload(record.id) == payload(record.header.seq)
        put(restored, header(200_000))
    assert store.verify() == ()


def test_a_backup_does_not_overwrite_files(store: Store, tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "file").write_text("precious")
    with pytest.raises(ConfigurationError, match="exists"):
        backup(store.directory, tmp_path / "there")
    assert (tmp_path / "there" / "file").read_text() == "precious"
    with pytest.raises(ConfigurationError, match="no store"):
        backup(tmp_path / "nowhere", tmp_path / "copy")


def test_a_backup_with_missing_payloads_fails_and_is_removed(store: Store, tmp_path: Path) -> None:
    put(store, header(0), payload(0))
    for path in (store.directory / "blobs").glob("??/*"):
        path.unlink()
    with pytest.raises(StorageError, match="try again"):
        backup(store.directory, tmp_path / "copy")
    assert not list(tmp_path.glob("copy*"))


def test_a_backup_of_a_corrupt_database_is_refused(tmp_path: Path) -> None:
    (tmp_path / "store.sqlite").write_bytes(b"not a database" * 100)
    with pytest.raises(StorageError, match="backup"):
        backup(tmp_path, tmp_path / "copy")

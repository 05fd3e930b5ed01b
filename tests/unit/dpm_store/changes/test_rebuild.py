# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A damaged or missing database is noticed, costs no payload, and is rebuilt from the records."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import ConfigurationError, StorageError
from cdff_common.geodesy import Body
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header, product_id
from dpm_store import NewProduct, Query, Store, open_store
from dpm_store.changes.rebuild import rebuild
from dpm_store.payloads.blobs import chunk_sums, digest

S = 1_000_000_000
DATABASE = ("store.sqlite", "store.sqlite-wal", "store.sqlite-shm")


def product(seq: int, size: int = 300) -> NewProduct:
    t_ns = seq * S
    header = Header(
        product_id("mana", "mapper", "map", t_ns, seq, "c"),
        seq,
        t_ns,
        t_ns,
        "mana/map",
        "mapper/1",
        config_hash="c",
        box_m=(float(seq), 0.0, 0.0, seq + 1.0, 1.0, 1.0),
    )
    payload = seq.to_bytes(4, "big") * (size // 4)
    return NewProduct(header, payload, "mana", "mapper", "map", "dem", "ElevationMap")


def tables(folder: Path) -> dict[str, list[Any]]:
    """Return the rows of all tables, ordered, except the R*Trees' own."""
    with sqlite3.connect(folder / "store.sqlite") as db:
        names = [
            row[0]
            for row in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
            if "_index_" not in row[0] and not row[0].startswith("sqlite")
        ]
        return {name: sorted(db.execute(f"SELECT * FROM {name}"), key=repr) for name in names}


def remove_database(folder: Path) -> None:
    for name in DATABASE:
        (folder / name).unlink(missing_ok=True)


def fill(folder: Path) -> None:
    """Make a store with insertions, deletions, annotations, frames, bodies, robots and events."""
    clock = ManualClock(1000 * S)
    with open_store(f"sqlite:///{folder}", clock) as store:
        for seq in range(20):
            clock.set_ns((1000 + seq) * S)
            store.put_all((product(seq, 300 if seq % 3 else 50_000),))
        ids = [product(seq).header.id for seq in range(20)]
        store.annotations.update(ids[3], {"tags": ["crater"], "pinned": True}, if_match=None)
        store.frames.set("mana/map", "site", UncertainTransform(np.eye(4)))
        store.anchors.define(Body("rubble", "asteroid"))
        store.robots.describe("mana", "a rover", {"sensors": ["lidar"]})
        store.events.append("mana", "alarm", {"reason": "test"})
        for seq in (5, 6):
            store.delete(ids[seq])
        store.put_all([product(seq) for seq in range(20, 30)])


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("filled") / "data"
    fill(folder)
    return folder


@pytest.fixture
def folder(filled: Path, tmp_path: Path) -> Path:
    """A copy of a store with all kinds of changes."""
    return shutil.copytree(filled, tmp_path / "data")


def test_a_store_with_payloads_and_without_database_is_not_opened(folder: Path) -> None:
    payloads = [path for path in folder.rglob("*") if path.is_file() and path.name not in DATABASE]
    remove_database(folder)
    with pytest.raises(StorageError, match="cdff dpm rebuild"):
        open_store(f"sqlite:///{folder}")
    assert not (folder / "store.sqlite").exists()
    (folder / "store.sqlite").touch()
    with pytest.raises(StorageError, match="no database that names them"):
        open_store(f"sqlite:///{folder}")
    assert all(path.exists() for path in payloads)


def test_a_missing_database_is_rebuilt_row_by_row(folder: Path) -> None:
    before = tables(folder)
    remove_database(folder)
    tile = folder / "tiles" / "site" / "0" / "0_0.tile"
    tile.parent.mkdir(parents=True)
    tile.touch()
    result = rebuild(folder)
    assert (result.products, result.lost) == (28, [])
    assert not tile.exists(), "tiles of the old database refer to its events"
    after = tables(folder)
    assert {name for name in before if before[name] != after[name]} == set()
    with open_store(f"sqlite:///{folder}") as store:
        assert store.verify() == ()
        assert len(store.search(Query(types=("dem",), limit=50)).items) == 28
        assert store.payload(product(9).header.id) == product(9, 50_000).payload


def test_a_database_that_lost_acknowledged_insertions_is_reported_and_rebuilt(
    folder: Path, tmp_path: Path
) -> None:
    with open_store(f"sqlite:///{folder}"):
        older = tmp_path / "older.sqlite"
        shutil.copy(folder / "store.sqlite", older)
    before = tables(folder)
    with open_store(f"sqlite:///{folder}") as store:
        store.put_all([product(seq) for seq in range(30, 45)])
    complete = tables(folder)
    remove_database(folder)
    shutil.copy(older, folder / "store.sqlite")
    assert tables(folder) == before
    with open_store(f"sqlite:///{folder}") as store:
        assert store.changes.loss.startswith("15 acknowledged changes")
        assert any("15 acknowledged changes" in problem.what for problem in store.verify())
        with pytest.raises(StorageError, match="rebuild"):
            store.collect()
    with open_store(f"sqlite:///{folder}") as store:  # also after the next start
        assert store.changes.loss.startswith("15 acknowledged changes")
    assert rebuild(folder).products == 43
    assert tables(folder) == complete
    with open_store(f"sqlite:///{folder}") as store:
        assert (store.changes.loss, store.verify()) == ("", ())


def test_products_of_a_database_created_with_new_are_kept_by_a_rebuild(folder: Path) -> None:
    remove_database(folder)
    with open_store(f"sqlite:///{folder}", new=True) as store:
        store.put_all([product(0, 50_000), product(100)])
        with pytest.raises(StorageError, match="rebuild"):
            store.collect()
        assert any("missing in the database" in problem.what for problem in store.verify())
    assert rebuild(folder).products == 29
    with open_store(f"sqlite:///{folder}") as store:
        assert store.verify() == ()
        assert store.get(product(100).header.id)


def test_a_product_whose_payload_is_gone_is_named(folder: Path) -> None:
    remove_database(folder)
    sha256 = digest(product(9, 50_000).payload)
    (folder / "blobs" / sha256[:2] / sha256[2:]).unlink()
    result = rebuild(folder)
    assert (result.products, result.lost) == (27, [product(9).header.id])
    with open_store(f"sqlite:///{folder}") as store:
        assert store.verify() == ()
        assert store.get(result.lost[0], deleted=True).deleted_ns is not None


def test_records_survive_a_kill_in_the_middle_of_one(folder: Path) -> None:
    (file,) = (folder / "changes").glob("*.changes")
    with file.open("ab") as end:
        end.write(b"\x40\x00\x00\x00half of a record")
    with open_store(f"sqlite:///{folder}") as store:
        assert store.changes.loss == ""
        store.put_all((product(70),))
    remove_database(folder)
    assert rebuild(folder).products == 29


def test_records_that_are_missing_are_written_at_the_next_start(folder: Path) -> None:
    shutil.rmtree(folder / "changes")
    open_store(f"sqlite:///{folder}").close()
    before = tables(folder)
    remove_database(folder)
    rebuild(folder)
    assert tables(folder) == before


def test_without_records_there_is_nothing_to_rebuild_from(folder: Path) -> None:
    shutil.rmtree(folder / "changes")
    remove_database(folder)
    with pytest.raises(ConfigurationError, match="restore a backup"):
        rebuild(folder)


def test_a_new_database_over_payloads_that_nothing_names_collects_none_of_them(folder: Path) -> None:
    shutil.rmtree(folder / "changes")
    remove_database(folder)
    with open_store(f"sqlite:///{folder}", new=True) as store:
        store.put_all((product(0, 50_000),))
        assert any("have no row" in problem.what for problem in store.verify())
        with pytest.raises(StorageError, match="most"):
            store.collect()
    rebuild(folder)
    with open_store(f"sqlite:///{folder}") as store, pytest.raises(StorageError, match="most"):
        store.collect()
    assert rebuild(folder, remove_unnamed=True).products == 1
    with open_store(f"sqlite:///{folder}") as store:
        assert (store.changes.loss, store.unnamed_payloads().files) == ("", 0)


def test_the_payload_of_an_interrupted_insertion_is_collected(store: Store) -> None:
    files, payload = store._payloads.files, b"x" * 50_000
    files.write(digest(payload), payload, chunk_sums(payload))
    assert [name for page in files.names() for name in page] == [digest(payload)]
    assert (store.unnamed_payloads().files, store.verify()) == (1, ())
    store.collect()
    assert [name for page in files.names() for name in page] == []

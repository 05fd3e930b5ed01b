# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Databases of earlier revisions, filled, then opened by this version."""

from pathlib import Path

import pytest
from sqlalchemy import insert, inspect

from cdff_common.clock import ManualClock
from cdff_common.geometry.region import parse_region
from dpm_store import Query, open_store, schema
from dpm_store.database import Database
from dpm_store.events import EventTable
from dpm_store.migrate import HEAD, migrate, revision_of
from dpm_store.products import INLINE_BYTES

from .conftest import NAMES, header, put

NEW = {"annotations", "product_tags", "pins", "supersessions", "pose_graph_nodes", "pose_graph_edges"}


@pytest.fixture
def of_0001(tmp_path: Path) -> Path:
    """A directory whose database has the first schema, with products, inline and in files, a tombstone and events."""
    database = Database(tmp_path / "store.sqlite")
    migrate(database, "0001")
    assert not NEW & set(inspect(database.engine).get_table_names())
    database.close()
    with open_store(f"sqlite:///{tmp_path}/new") as filled:  # the same rows, made by the code of today
        for seq in range(6):
            put(filled, header(seq, box_m=(seq, 0, 0, seq + 1, 1, 1), inputs=("a",)), _payload(seq))
        filled.delete(header(5).id)
        with filled._database.read() as source:
            rows = {
                table: [dict(row._mapping) for row in source.execute(table.select())]
                for table in schema.metadata.sorted_tables
                if table.name not in NEW
            }
            index = source.exec_driver_sql("SELECT * FROM product_index").all()
    database = Database(tmp_path / "store.sqlite")
    with database.write() as connection:
        for table, found in rows.items():
            if found:
                connection.execute(insert(table), found)
        for entry in index:
            connection.exec_driver_sql("INSERT INTO product_index VALUES (?,?,?,?,?,?,?,?,?,?,?)", tuple(entry))
    EventTable(database, ManualClock(7)).append("mana", "alarm", {"what": "test"})
    database.close()
    (tmp_path / "new" / "blobs").rename(tmp_path / "blobs")
    return tmp_path


def _payload(seq: int) -> bytes:
    return bytes([seq]) * (INLINE_BYTES + 1 if seq % 2 else 100)


def test_a_filled_store_of_the_first_schema_keeps_everything(of_0001: Path) -> None:
    database = Database(of_0001 / "store.sqlite")
    assert revision_of(database) == "0001"
    database.close()
    with open_store(f"sqlite:///{of_0001}") as store:
        assert revision_of(store._database) == HEAD
        assert store.verify() == ()
        found = store.search(Query(region=parse_region("bbox:0,0,2.5,1"), oldest_first=True)).items
        assert [record.header.seq for record in found] == [0, 1, 2]
        for seq in range(5):
            assert store.payload(header(seq).id) == _payload(seq)
        assert store.get(header(5).id, deleted=True).deleted_ns is not None
        assert [e.kind for e in store.events.since()] == ["inserted"] * 6 + ["deleted", "alarm"]


def test_a_store_that_was_brought_up_takes_what_is_new(of_0001: Path) -> None:
    with open_store(f"sqlite:///{of_0001}") as store:
        store.annotations.update(header(0).id, {"tags": ["old"]}, if_match=0)
        put(store, header(7), **NAMES)
    with open_store(f"sqlite:///{of_0001}") as store:
        assert store.annotations.get(header(0).id).tags == ("old",)
        assert store.statistics().count == 6

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Databases of earlier revisions, filled, then opened by this version."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import MetaData, Table, insert, inspect

from cdff_common.clock import ManualClock
from cdff_common.codecs import encode
from cdff_common.errors import ConfigurationError, StorageError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import parse_region
from cdff_common.interfaces.product import CovarianceKind, Quality
from cdff_common.types import TransformWithCovariance
from dpm_store import Query, Store, open_store, schema
from dpm_store.blobs import digest
from dpm_store.database import Database
from dpm_store.events import EventTable
from dpm_store.frames import Known
from dpm_store.migrate import HEAD, migrate, revision_of
from dpm_store.payloads import PACKED_BYTES
from dpm_store.records import Order

from .conftest import NAMES, header, put

pytestmark = pytest.mark.req("CDFF-SUP-032")
QUALITY = Quality(covariance_kind=CovarianceKind.FORMAL, metrics={"inliers": 40.0})


@pytest.fixture(params=["0001", "0002", "0004"])
def old(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A directory whose database has an earlier schema, with products, inline and in files, a tombstone, frames, poses
    and events: what the code of today writes, less what that schema has no place for."""
    with open_store(f"sqlite:///{tmp_path}/new", ManualClock(1_000_000_000_000)) as filled:
        _fill(filled)
        contents = {p.sha256: filled.payload(p.id) for p in filled.search(Query(limit=1000)).items}
        contents |= {digest(_payload(5)): _payload(5)}
    source, target = Database(tmp_path / "new" / "store.sqlite"), Database(tmp_path / "store.sqlite")
    migrate(target, request.param)
    assert "content" in {column["name"] for column in inspect(target.engine).get_columns("blobs")}
    with source.read() as there, target.write() as here:
        for name in inspect(target.engine).get_table_names():
            table = Table(name, MetaData(), autoload_with=target.engine)
            columns = [column.name for column in table.c]
            if name in schema.metadata.tables and "tallies" not in name:  # those are kept by triggers
                found = there.execute(schema.metadata.tables[name].select()).mappings().all()
                rows = [{column: row[column] for column in columns if column != "content"} for row in found]
                if name == "blobs":  # small ones lay in the database
                    rows = [
                        {**row, "content": contents[row["sha256"]] if row["size"] <= PACKED_BYTES else None}
                        for row in rows
                    ]
                if rows:
                    here.execute(insert(table), rows)
        for index in ("product_index", "deleted_index") if request.param >= "0003" else ("product_index",):
            for entry in there.exec_driver_sql(f"SELECT * FROM {index}"):
                here.exec_driver_sql(f"INSERT INTO {index} VALUES (?,?,?,?,?,?,?,?,?,?,?)", tuple(entry))
        if request.param == "0001":  # deleting took the pose with it then
            here.exec_driver_sql("DELETE FROM poses WHERE stamp_ns = 21000000000")
    EventTable(target, ManualClock(7)).append("mana", "alarm", {"what": "test"})
    source.close()
    target.close()
    (tmp_path / "new" / "blobs").rename(tmp_path / "blobs")
    return tmp_path


def _fill(store: Store) -> None:
    for seq in range(6):
        put(store, header(seq, box_m=(seq, 0, 0, seq + 1, 1, 1), inputs=("a",), quality=QUALITY), _payload(seq))
    store.delete(header(5).id)
    for x_m in (1.0, 2.0):
        store.frames.set("mana/odom", "site", _at(x_m))
    for stamp_ns in (20_000_000_000, 22_000_000_000):
        pose = TransformWithCovariance.from_transform(
            _at(stamp_ns / 1e9), parent="mana/odom", child="mana/base", stamp_ns=stamp_ns
        )
        a_header = header(stamp_ns // 10**9, t1_ns=stamp_ns, frame="mana/odom", child="mana/base")
        put(store, a_header, encode(pose, "uper"), product="pose", type_name="TransformWithCovariance")


def _at(x_m: float) -> UncertainTransform:
    matrix = np.eye(4)
    matrix[0, 3] = x_m
    return UncertainTransform(matrix)


def _payload(seq: int) -> bytes:
    return bytes([seq]) * (PACKED_BYTES + 1 if seq % 2 else 100)


def test_a_filled_store_of_an_earlier_schema_keeps_everything(old: Path) -> None:
    with open_store(f"sqlite:///{old}") as store:
        assert revision_of(store._database) == HEAD
        assert store.verify() == ()
        found = store.search(Query(types=("dem",), region=parse_region("bbox:0,0,2.5,1"), order=Order.OLDEST)).items
        assert [record.header.seq for record in found] == [0, 1, 2]
        for seq in range(5):
            assert store.payload(header(seq).id) == _payload(seq)
        assert store.get(header(5).id, deleted=True).deleted_ns is not None
        kinds = [e.kind for e in store.events.since()]
        assert kinds == ["inserted"] * 6 + ["deleted"] + ["reanchored"] * 2 + ["inserted"] * 2 + ["alarm"]


def test_what_is_new_is_filled_from_what_was_there(old: Path) -> None:
    with open_store(f"sqlite:///{old}") as store:
        assert [r.state for r in store.frames.revisions("mana/odom")] == [1, 2]
        assert store.frames.lookup("site", "mana/odom", known=Known(state=1)).matrix[0, 3] == 1.0
        pose = store.poses.at(21_000_000_000, "site", "mana/base", known=Known(as_of_ns=1_000_000_000_000))
        assert pose.matrix[0, 3] == pytest.approx(2.0 + 21.0)
        with store._database.read() as connection:
            metrics = connection.exec_driver_sql("SELECT count(*), min(value) FROM product_metrics").one()
            kinds = connection.exec_driver_sql("SELECT count(*) FROM products WHERE covariance_kind='formal'").scalar()
            deleted = connection.exec_driver_sql("SELECT id, x0, x1 FROM deleted_index").all()
        assert tuple(metrics) == (6, 40.0)
        assert kinds == 6
        assert [row.id for row in deleted] == [6]
        assert tuple(deleted[0][1:]) == pytest.approx((4.95, 6.05))  # the index pads its boxes


def test_small_payloads_lie_in_packs_afterwards_and_in_the_database_no_more(old: Path) -> None:
    with open_store(f"sqlite:///{old}") as store:
        assert [path.stat().st_size for path in (old / "packs").iterdir()] == [3 * 100 + sum(_pose_sizes(store))]
        assert len(list((old / "blobs").glob("??/*"))) == 3
        with store._database.read() as connection:
            assert [column["name"] for column in inspect(connection).get_columns("blobs")][-2:] == ["place", "live"]
        store.delete(header(0).id)
        store.delete(header(1).id)
        assert store.collect() == 100 + 2 * len(_payload(1))  # product 5 was deleted before
        assert store.verify() == ()


def test_a_migration_that_fails_midway_is_begun_anew(old: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as failing:
        failing.setattr("dpm_store.sqlite.DDL_0005", ("UPDATE nowhere SET a = 0",))
        with pytest.raises(StorageError, match="nowhere"):
            open_store(f"sqlite:///{old}")
    with open_store(f"sqlite:///{old}") as store:
        assert store.verify() == ()
        assert store.payload(header(0).id) == _payload(0)


def _pose_sizes(store: Store) -> list[int]:
    return [record.size for record in store.search(Query(types=("pose",))).items]


def test_a_store_that_was_brought_up_takes_what_is_new(old: Path) -> None:
    with open_store(f"sqlite:///{old}") as store:
        store.annotations.update(header(0).id, {"tags": ["old"]}, if_match=0)
        put(store, header(7), **NAMES)
        store.delete(header(7).id)
    with open_store(f"sqlite:///{old}") as store:
        assert store.annotations.get(header(0).id).tags == ("old",)
        assert store.statistics().count == 7


def test_a_store_of_a_newer_version_is_refused(tmp_path: Path) -> None:
    open_store(f"sqlite:///{tmp_path}").close()
    database = Database(tmp_path / "store.sqlite")
    with database.write() as connection:
        connection.exec_driver_sql("UPDATE alembic_version SET version_num = '9999'")
    database.close()
    with pytest.raises(ConfigurationError, match="9999"):
        open_store(f"sqlite:///{tmp_path}")

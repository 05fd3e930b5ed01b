# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""PostgreSQL: its tables, settings, several stores on one database, and ends of the servers."""

from __future__ import annotations

import random
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from sqlalchemy import inspect, select, text

from cdff_common.clock import ManualClock
from cdff_common.errors import CdffError, ConfigurationError, StorageError
from dpm_store import Query, Store, open_store
from dpm_store import engine as engines
from dpm_store.engine import schema
from dpm_store.engine.database import DIALECTS
from dpm_store.engine.location import parse_url
from dpm_store.payloads.object_store import ObjectStore
from dpm_store.payloads.payloads import PACKED_BYTES
from tests.support import postgresql, seaweedfs
from tests.support.store_products import header, put

ON_SERVER = pytest.mark.parametrize("engine", [pytest.param("postgresql", marks=pytest.mark.slow)])
WITH_OBJECTS = pytest.mark.parametrize("engine", [pytest.param("postgresql+s3", marks=pytest.mark.slow)])


@ON_SERVER
def test_the_tables_and_columns_are_those_of_sqlite(store: Store, engine: str) -> None:
    with store._database.read() as connection:
        tables = inspect(connection)
        for name, table in schema._tables.items():
            columns = {column["name"]: column["nullable"] for column in tables.get_columns(name)}
            assert columns == {column.name: column.nullable for column in table.columns}, name


@ON_SERVER
def test_commits_are_durable_and_readers_see_one_state(store: Store, engine: str) -> None:
    with store._database.read() as connection:
        assert connection.execute(text("SHOW synchronous_commit")).scalar_one() == "on"
        before = connection.execute(text("SELECT count(*) FROM products")).scalar_one()
        put(store, header(0))
        assert connection.execute(text("SELECT count(*) FROM products")).scalar_one() == before


def copy_of(url: str, directory: Path) -> str:
    """Return the URL of a store with another directory."""
    return url.replace(str(parse_url(url).directory), str(directory))


@WITH_OBJECTS
def test_several_stores_on_one_database_write_in_one_order_and_see_each_other(
    engine: str, new_store: Callable[[Path], str], tmp_path: Path, clock: ManualClock
) -> None:
    url = new_store(tmp_path / "first")
    with open_store(url, clock) as first, open_store(copy_of(url, tmp_path / "second"), clock) as second:

        def write(store: Store, start: int) -> None:
            for seq in range(start, start + 10):
                put(store, header(seq), bytes([seq]) * (PACKED_BYTES + 1 if seq % 5 == 0 else 100))

        threads = [threading.Thread(target=write, args=pair) for pair in ((first, 0), (second, 100))]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert [event.ordinal for event in second.events.since()] == list(range(1, 21))
        for seq in (*range(10), *range(100, 110)):
            expected = bytes([seq]) * (PACKED_BYTES + 1 if seq % 5 == 0 else 100)
            assert first.payload(header(seq).id) == second.payload(header(seq).id) == expected
        second.delete(header(0).id)
        second.delete(header(1).id)
        second.collect()
        assert len(first.search(Query(limit=100)).items) == 18
        assert first.verify() == second.verify() == ()


@ON_SERVER
def test_rows_that_were_read_ahead_are_used_once_and_only_in_their_transaction(
    store: Store, engine: str
) -> None:
    statement = select(schema.products.c.id)
    put(store, header(0))
    with store._database.read() as connection:
        store._database.dialect.fetch_ahead(connection, (statement,))
        ahead = store._database.dialect.fetch(connection, statement)
        assert [row[0] for row in ahead] == [header(0).id]
        assert store._database.dialect.fetch(connection, statement) == ahead
        store._database.dialect.fetch_ahead(connection, (statement,))
    put(store, header(1))
    with store._database.read() as connection:
        assert len(store._database.dialect.fetch(connection, statement)) == 2


@pytest.fixture
def durable(tmp_path: Path) -> Iterator[postgresql.Cluster]:
    """A server that syncs its commits, with an empty database ``a``."""
    if reason := postgresql.missing():
        pytest.skip(reason)
    with postgresql.cluster() as cluster:
        cluster.execute("CREATE DATABASE a")
        yield cluster


@pytest.mark.slow
def test_acknowledged_products_survive_the_end_of_the_database(
    durable: postgresql.Cluster, tmp_path: Path, clock: ManualClock
) -> None:
    acknowledged: list[int] = []
    is_killed, are_enough = threading.Event(), threading.Event()

    def write(store: Store) -> None:
        for seq in range(100_000):
            try:
                put(store, header(seq), b"payload %d" % seq)
            except StorageError:
                is_killed.set()
                return
            acknowledged.append(seq)
            if len(acknowledged) == 20:
                are_enough.set()

    with open_store(durable.url("a", tmp_path / "data"), clock) as store:
        for _ in range(3):
            acknowledged.clear()
            are_enough.clear()
            writer = threading.Thread(target=write, args=(store,))
            writer.start()
            assert are_enough.wait(120.0)
            durable.kill()
            writer.join()
            assert is_killed.is_set()
            durable.start()
            for seq in acknowledged:
                assert store.payload(header(seq).id) == b"payload %d" % seq
            assert store.verify() == ()
            for record in store.search(Query(limit=1000)).items:
                assert record.header.seq <= len(acknowledged)


@pytest.mark.slow
def test_without_the_object_store_nothing_is_acknowledged_and_nothing_is_lost(
    durable: postgresql.Cluster, tmp_path: Path, clock: ManualClock
) -> None:
    if reason := seaweedfs.missing():
        pytest.skip(reason)
    with seaweedfs.object_server() as objects:
        url = durable.url("a", tmp_path / "data", f"s3://{seaweedfs.BUCKET}/a")
        with open_store(url, clock) as store:
            for seq in range(20):
                put(store, header(seq), bytes([seq]) * (PACKED_BYTES + 1 if seq % 2 else 100))
            objects.kill()
            for size in (100, PACKED_BYTES + 1):
                with pytest.raises(StorageError, match=r"object s3://"):
                    put(store, header(100), b"z" * size)
            objects.start()
            assert put(store, header(100), b"z")
            for seq in range(20):
                assert store.payload(header(seq).id)[:1] == bytes([seq])
            assert store.verify() == ()


@pytest.mark.slow
def test_a_store_with_wrong_keys_is_refused(
    durable: postgresql.Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if reason := seaweedfs.missing():
        pytest.skip(reason)
    with seaweedfs.object_server():
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "wrong")
        with pytest.raises(ConfigurationError, match="AWS_SECRET_ACCESS_KEY"):
            open_store(durable.url("a", tmp_path / "data", f"s3://{seaweedfs.BUCKET}/a"))


@pytest.mark.slow
def test_a_half_written_object_is_reported_and_never_served(
    durable: postgresql.Cluster, tmp_path: Path, clock: ManualClock
) -> None:
    if reason := seaweedfs.missing():
        pytest.skip(reason)
    payload = random.Random(1).randbytes(2 * PACKED_BYTES)  # of which each has an object of its own
    with seaweedfs.object_server():
        url = durable.url("a", tmp_path / "first", f"s3://{seaweedfs.BUCKET}/a")
        with open_store(url, clock) as store:
            put(store, header(0), payload)
            put(store, header(1), payload[::-1])
        objects = ObjectStore(f"s3://{seaweedfs.BUCKET}/a")
        half = max((size, name) for page in objects.list("") for name, size in page)[1]
        objects.put(half, objects.get(half)[:PACKED_BYTES])
        with open_store(copy_of(url, tmp_path / "second"), clock) as store:
            answers = []
            for seq in (0, 1):
                try:
                    answers.append(store.payload(header(seq).id))
                except CdffError as error:
                    answers.append(type(error).__name__)
            assert len([a for a in answers if isinstance(a, bytes)]) == 1
            assert set(answers) <= {payload, payload[::-1], "StorageError", "CorruptPayloadError"}
            assert len(store.verify()) == 1
            put(store, header(2), b"other")
            assert store.payload(header(2).id) == b"other"


@pytest.mark.slow
def test_a_database_that_only_reads_refuses_insertions_and_answers_searches(
    durable: postgresql.Cluster, tmp_path: Path, clock: ManualClock
) -> None:
    url = durable.url("a", tmp_path / "data")
    with open_store(url, clock) as store:
        put(store, header(0))
    durable.execute("ALTER DATABASE a SET default_transaction_read_only = on")
    with open_store(url, clock) as store:
        with pytest.raises(StorageError, match="read-only transaction"):
            put(store, header(1))
        assert [r.id for r in store.search(Query()).items] == [header(0).id]
    durable.execute("ALTER DATABASE a SET default_transaction_read_only = off")
    with open_store(url, clock) as store:
        assert put(store, header(1))


@pytest.mark.slow
def test_a_refused_user_and_a_missing_database_are_reported_without_the_password(
    durable: postgresql.Cluster, tmp_path: Path
) -> None:
    url = durable.url("a", tmp_path / "data")
    for wrong, reason in (
        (url.replace(f"{postgresql.USER}@", "other:secret@"), 'role "other" does not exist'),
        (durable.url("missing", tmp_path / "data"), 'database "missing" does not exist'),
    ):
        with pytest.raises(StorageError, match=reason) as refused:
            open_store(wrong)
        assert "secret" not in str(refused.value)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("revision", "message"),
    [("r9", r"schema r9, this version reads up to r1; open it with a newer version"), ("0004", "unreleased")],
)
def test_a_database_of_another_version_is_refused_and_unchanged(
    durable: postgresql.Cluster, tmp_path: Path, clock: ManualClock, revision: str, message: str
) -> None:
    url = durable.url("a", tmp_path / "data")
    with open_store(url, clock) as store:
        put(store, header(0))
    durable.execute(f"UPDATE alembic_version SET version_num = '{revision}'", "a")
    with pytest.raises(ConfigurationError, match=message):
        open_store(url, clock)
    durable.execute("UPDATE alembic_version SET version_num = 'r1'", "a")
    with open_store(url, clock) as store:
        assert store.get(header(0).id)


@pytest.mark.slow
def test_processes_whose_clocks_differ_write_one_history(durable: postgresql.Cluster, tmp_path: Path) -> None:
    hour_ns = 3_600_000_000_000
    ahead, behind = ManualClock(10 * hour_ns), ManualClock(9 * hour_ns)
    url = durable.url("a", tmp_path / "first")
    other = durable.url("a", tmp_path / "second")
    with open_store(url, ahead) as first, open_store(other, behind) as second:
        for seq, store in enumerate((first, second, first, second)):
            put(store, header(seq))
        for store in (first, second):
            events = store.events.since(kind="inserted")
            assert [event.body["id"] for event in events] == [header(seq).id for seq in range(4)]
            assert len({event.ordinal for event in events}) == 4
            assert store.verify() == ()


@ON_SERVER
def test_conditions_on_listed_products_do_not_replace_the_list_by_an_interval_of_time(
    store: Store, engine: str
) -> None:
    put(store, header(0))
    listed = store._database.dialect.listed_products(["ordinal", "product", "t1_ns"])
    statement = select(listed.c.ordinal).where(listed.c.product == "dem", listed.c.t1_ns >= 0)
    with store._database.read() as connection:
        connection.execute(text("SET LOCAL enable_seqscan = off"))
        compiled = statement.compile(connection.engine)
        plan = connection.exec_driver_sql(
            f"EXPLAIN {compiled}", {**compiled.params, "ordinals": list(range(30))}
        )
        lines = "\n".join(line for (line,) in plan)
    assert "Filter: ((listed_products.t1_ns >= " in lines
    assert "products_by_type" not in lines


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("postgresql://x/y", "expected sqlite:///"),
        ("postgresql+psycopg://a:secret@x/y", "no directory"),
        ("postgresql+psycopg://a:secret@x/y?directory=/d&cache_mb=many", "cache_mb"),
    ],
)
def test_a_url_of_another_form_is_refused_without_its_password(url: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message) as refused:
        parse_url(url)
    assert "secret" not in str(refused.value)


def test_without_the_driver_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    monkeypatch.delitem(sys.modules, "dpm_store.engine.postgresql", raising=False)
    monkeypatch.delattr(engines, "postgresql", raising=False)
    monkeypatch.delitem(DIALECTS, "postgresql", raising=False)
    with pytest.raises(ConfigurationError, match=r"cdff\[scale\]"):
        parse_url("postgresql+psycopg://x/y?directory=/d")


def test_the_embedded_store_imports_neither_driver() -> None:
    code = (
        "import sys, tempfile, dpm_store\n"
        "with tempfile.TemporaryDirectory() as d: dpm_store.open_store(f'sqlite:///{d}').close()\n"
        "names = ('psycopg', 'obstore', 'dpm_store.engine.postgresql')\n"
        "print([name for name in names if name in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""SQLite: settings of its connections, exclusive writers, copies, defects, and rounding of the index."""

from __future__ import annotations

import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import Connection, text
from sqlalchemy.exc import OperationalError

from cdff_common.errors import StorageError
from dpm_store.engine import sqlite
from dpm_store.engine.database import Database
from dpm_store.engine.dialect import WRITES
from dpm_store.engine.migrate import migrate


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = Database(tmp_path, dialect=sqlite)
    migrate(opened)
    yield opened
    opened.close()


def pragma(connection: Connection, name: str) -> object:
    return connection.execute(text(f"PRAGMA {name}")).scalar_one()


def test_writers_have_a_larger_page_cache_than_readers_on_the_same_connection(tmp_path: Path) -> None:
    engine = sqlite.open_engine(tmp_path / "a.sqlite")
    sizes = []
    for writes in (True, False, False, True):  # one after the other: the pool gives the same connection
        with engine.connect().execution_options(**{WRITES: writes}) as connection:
            sizes.append(pragma(connection, "cache_size"))
    with engine.connect() as connection:  # without the option it reads
        sizes.append(pragma(connection, "cache_size"))
    engine.dispose()
    assert sizes == [-65536, -4096, -4096, -65536, -4096]


def test_every_commit_is_synced_to_a_write_ahead_log(tmp_path: Path) -> None:
    engine = sqlite.open_engine(tmp_path / "a.sqlite")
    with engine.connect() as connection:
        values = {n: pragma(connection, n) for n in ("journal_mode", "synchronous", "wal_autocheckpoint")}
        waits_ms = pragma(connection, "busy_timeout")
    engine.dispose()
    assert values == {"journal_mode": "wal", "synchronous": 2, "wal_autocheckpoint": 16000}
    assert waits_ms == 10_000


def test_a_transaction_that_writes_excludes_others_from_its_start_and_one_that_reads_does_not(
    tmp_path: Path,
) -> None:
    engine = sqlite.open_engine(tmp_path / "a.sqlite")
    for writes in (False, True):
        with (
            engine.connect().execution_options(**{WRITES: writes}) as first,
            engine.connect() as other,
        ):
            first.execute(text("SELECT 1"))
            other.execute(text("PRAGMA busy_timeout=1"))
            other.rollback()
            other = other.execution_options(**{WRITES: True})
            if writes:
                with pytest.raises(OperationalError, match="locked"):
                    other.execute(text("SELECT 1"))
            else:
                assert other.execute(text("SELECT 1")).scalar_one() == 1
    engine.dispose()


def test_the_copy_of_a_database_in_use_is_one_file_and_a_source_that_is_none_is_refused(
    database: Database, tmp_path: Path
) -> None:
    target = tmp_path / "copy.sqlite"
    with database.write() as connection:
        connection.execute(text("INSERT INTO meta (name, value) VALUES ('a', 'b')"))
    with sqlite.copied(tmp_path / sqlite.FILE_NAME, target) as copy:
        assert copy.execute(text("SELECT value FROM meta WHERE name = 'a'")).scalar_one() == "b"
        assert pragma(copy, "journal_mode") == "delete"
    assert not list(tmp_path.glob("copy.sqlite-*"))
    (tmp_path / "text").write_text("no database" * 1000, encoding="utf-8")
    with (
        pytest.raises(StorageError, match=r"backup of .*not a database"),
        sqlite.copied(tmp_path / "text", tmp_path / "other.sqlite"),
    ):
        pass


def test_a_checkpoint_empties_the_log(database: Database, tmp_path: Path) -> None:
    with database.write() as connection:
        connection.execute(text("INSERT INTO meta (name, value) VALUES ('a', 'b')"))
    log = tmp_path / f"{sqlite.FILE_NAME}-wal"
    assert log.stat().st_size > 0
    engine = sqlite.open_engine(tmp_path / sqlite.FILE_NAME)
    sqlite.checkpoint(engine)
    assert log.stat().st_size == 0
    engine.dispose()


def test_entries_without_a_product_are_defects_of_the_index(database: Database) -> None:
    with database.write() as connection:
        assert sqlite.check(connection) == []
        sqlite.index_products(connection, [(5, (1, (0.0, 0, 0, 1, 1, 1)), (10.0, 20.0))])
        assert sqlite.check(connection) == ["spatial index: 1 entries without a product"]


def test_end_keys_bound_the_end_of_capture_within_a_second(database: Database) -> None:
    ends_s = [0.0, 0.25, 1234.5, -86_400.0, 3e7, 5e8]
    box = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
    with database.write() as connection:
        sqlite.index_products(connection, [(i + 1, (0, box), (t - 1.0, t)) for i, t in enumerate(ends_s)])
        for number, t in enumerate(ends_s):
            candidates = sqlite.candidates_between(connection, "product_index", [(0, box)], (t, t), None)
            (key,) = (key for ordinal, key in candidates if ordinal == number + 1)
            low, high = sqlite.end_bounds_s(key)
            assert low <= t <= high
            assert high - low < 1e-4 + 1.3e-6 * abs(t) + 60 * 2e-6


def test_products_at_the_limits_of_an_interval_and_box_are_found_and_others_are_not(
    database: Database,
) -> None:
    unit = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
    everywhere = (-math.inf, -math.inf, -math.inf, math.inf, math.inf, math.inf)
    entries = [
        (1, (7, unit), (100.0, 200.0)),
        (2, (8, unit), (100.0, 200.0)),  # another frame or type
        (3, (7, tuple(np.add(unit, 10.0))), (100.0, 200.0)),
        (4, (7, unit), (300.0, 400.0)),
    ]

    def found(box: tuple[float, ...], ends: tuple[float, float], before: float | None = None) -> set[int]:
        rows = sqlite.candidates_between(connection, "product_index", [(7, box)], ends, before)
        return {ordinal for ordinal, _ in rows}

    with database.write() as connection:
        sqlite.index_products(connection, entries)  # type: ignore[arg-type]
        assert found(everywhere, (200.0, 400.0)) == {1, 3, 4}
        assert found(everywhere, (201.0, 399.0)) == set()
        assert found(everywhere, (200.0, 400.0), before=300.0) == {1, 3, 4}
        assert found(everywhere, (200.0, 400.0), before=299.0) == {1, 3}
        for axis in range(3):
            beyond, touching = np.array(unit), np.array(unit)
            beyond[[axis, axis + 3]] = 1.2, 9.8
            touching[[axis, axis + 3]] = 1.0, 10.0
            touching[[a + 3 for a in range(3) if a != axis]] = 10.0
            assert found(tuple(beyond), (200.0, 200.0)) == set()
            assert found(tuple(touching), (200.0, 200.0)) == {1, 3}
        both = sqlite.candidates_between(
            connection, "product_index", [(7, unit), (7, unit), (8, unit)], (0.0, 500.0), None
        )
        assert sorted(ordinal for ordinal, _ in both) == [1, 2, 4]


def test_a_connection_can_be_used_by_another_thread_than_the_one_that_opened_it(tmp_path: Path) -> None:
    engine = sqlite.open_engine(tmp_path / "a.sqlite")
    connection = engine.raw_connection()
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(lambda: connection.cursor().execute("SELECT 1").fetchall()).result() == [(1,)]
    connection.close()
    engine.dispose()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every engine implements the dialect interface with the same behaviour."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from sqlalchemy import Connection, bindparam, func, select

from dpm_store.engine import schema
from dpm_store.engine.database import Database, dialect_of
from dpm_store.engine.location import parse_url
from dpm_store.engine.migrate import migrate
from tests.support.postgresql import ONLY_EMBEDDED

BOX = (0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
LARGE = (-math.inf, 0.5, -math.inf, math.inf, 0.6, math.inf)


@pytest.fixture
def database(new_store: Callable[[Path], str], tmp_path: Path) -> Iterator[Database]:
    """An empty database of each engine."""
    (tmp_path / "data").mkdir()
    location = parse_url(new_store(tmp_path / "data"))
    opened = Database(location.directory, dialect=location.dialect, url=location.database)
    migrate(opened)
    yield opened
    opened.close()


@pytest.fixture
def connection(database: Database) -> Iterator[Connection]:
    """A connection in a write transaction."""
    with database.write() as connection:
        yield connection


def test_the_engine_of_a_connection_is_found(database: Database, connection: Connection) -> None:
    assert dialect_of(connection) is database.dialect


def test_a_statement_is_fetched_with_values_and_lists(database: Database, connection: Connection) -> None:
    dialect, m = database.dialect, schema.meta.c
    dialect.insert_rows(connection, schema.meta, [{"name": name, "value": name} for name in "abcd"])
    statement = select(m.value).where(m.name.in_(dialect.elements("names")), m.name > bindparam("low"))
    values = {"names": dialect.list_value(["a", "b", "x"]), "low": "a"}
    assert dialect.fetch(connection, statement, values) == [("b",)]
    assert dialect.fetch(connection, select(func.count()).select_from(schema.meta)) == [(4,)]


def test_rows_are_ignored_added_to_or_replaced(database: Database, connection: Connection) -> None:
    dialect = database.dialect
    blob = {"sha256": "0" * 64, "size": 3, "chunk_sums": b"", "location": 7, "live": 1}
    for location in (7, None, 9):
        row = blob | {"location": location}
        dialect.upsert_rows(connection, schema.blobs, [row], add=("live",), replace=("location",))
    connection.execute(dialect.insert_or_ignore(schema.blobs), blob | {"live": 50})
    b = schema.blobs.c
    assert dialect.fetch(connection, select(b.live, b.location)) == [(3, 9)]


def test_the_spatial_index_returns_candidates_by_bucket_box_and_time(
    database: Database, connection: Connection
) -> None:
    dialect, live = database.dialect, database.dialect.INDEXES[0]
    entries = [(1, (1, BOX), (0.0, 10.0)), (2, (2, BOX), (0.0, 10.0)), (3, (1, BOX), (500.0, 600.0))]
    dialect.index_products(connection, entries)

    def between(first_s: float, last_s: float) -> dict[int, float]:
        return dict(dialect.candidates_between(connection, live, [(1, LARGE)], (first_s, last_s), None))

    assert set(between(-math.inf, math.inf)) == {1, 3}
    low_s, high_s = dialect.end_bounds_s(between(0.0, 20.0)[1])
    assert low_s <= 10.0 <= high_s
    values = dialect.candidate_values([(1, LARGE)], (-math.inf, 100.0))
    assert connection.execute(dialect.candidates(live), values).scalars().all() == [1]


def test_a_deleted_product_moves_to_the_second_index(database: Database, connection: Connection) -> None:
    dialect = database.dialect
    dialect.index_products(connection, [(1, (1, BOX), (0.0, 1.0))])
    dialect.index_deleted(connection, 1)
    result = [
        [row[0] for row in dialect.candidates_between(connection, index, [(1, BOX)], (0.0, 1.0), None)]
        for index in dialect.INDEXES
    ]
    assert result == [[], [1]]


def test_a_new_database_has_no_defects(database: Database) -> None:
    database.dialect.checkpoint(database.engine)
    with database.read() as connection:
        assert database.dialect.check(connection) == []


@ONLY_EMBEDDED
def test_a_connection_that_writes_has_the_larger_page_cache(database: Database) -> None:
    """A reused connection changes its cache with its task."""
    sizes = []
    for transaction in (database.write, database.read, database.read, database.write):
        with transaction() as connection:
            sizes.append(connection.exec_driver_sql("PRAGMA cache_size").scalar_one())
    assert sizes == [-65536, -4096, -4096, -65536]

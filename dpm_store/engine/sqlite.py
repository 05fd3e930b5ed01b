# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""SQLite: implementation of ``Dialect`` with a write-ahead log and the R*Tree.

Transactions are started here and not by the driver: SQLAlchemy's default allows lost updates, and a deferred
BEGIN that becomes a write fails in a way that no timeout retries. Writers use BEGIN IMMEDIATE, readers a WAL
snapshot. The R*Tree stores float32, rounded outwards: its results are candidates that the caller compares
exactly. To keep the rounding within millimetres and seconds, boxes are in the product's own frame and time is
relative to an epoch. The five dimensions are the bucket (frame and type), x, y, z and time.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import (
    BindParameter,
    ColumnElement,
    Connection,
    Engine,
    Select,
    Subquery,
    Table,
    bindparam,
    create_engine,
    event,
    literal_column,
    select,
    text,
)
from sqlalchemy.dialects.sqlite import Insert, insert
from sqlalchemy.dialects.sqlite.pysqlite import dialect as pysqlite
from sqlalchemy.exc import DatabaseError

from cdff_common.errors import OverloadedError, StorageError
from dpm_store.engine import schema
from dpm_store.engine.commit_watch import CommitWatch, EmbeddedWatch
from dpm_store.engine.dialect import WRITES, IndexBox, IndexEntry

FILE_NAME = "store.sqlite"
is_shared = False
Error = sqlite3.Error
INDEXES = ("product_index", "deleted_index")
#: Page cache of a connection while it writes, and while it reads.
_WRITER_KB, _READER_KB = 65536, 4096
#: Replaces an infinite bound in the index: float32 can represent it.
_LARGEST_BOUND = 1e30
#: Scales of the index. The R*Tree splits nodes by volume and margin: no side may be 0, buckets must be far
#: apart, and half a minute counts as much as a metre. Measured in ADR 6. A bucket is stored as the interval
#: [n, n + ½]·_BUCKET and searched at (n + ¼)·_BUCKET, so that float32 rounding does not matter.
_BUCKET, _PAD_M, _PAD_S, _PER_S = 65536.0, 0.05, 0.5, 0.03
_BETWEEN = (
    "SELECT id, t1 FROM {} WHERE bucket0 <= ? AND bucket1 >= ? AND x0 <= ? AND x1 >= ? "
    "AND y0 <= ? AND y1 >= ? AND z0 <= ? AND z1 >= ? AND t0 <= ? AND t1 >= ? AND t1 <= ? LIMIT ?"
)
#: Forces a lookup by ordinal: the planner would choose an index of ``products``, which is slower.
_LISTED = (
    "FROM (SELECT value FROM json_each(:ordinals)) AS listed "
    "CROSS JOIN products NOT INDEXED ON products.ordinal = listed.value"
)
#: Wildcards of ``LIKE`` as those of ``GLOB``.
_GLOB = {"%": "*", "_": "?"}
#: Instructions of SQLite between two checks of the time, and a time after which a caller may try again.
_STEPS, _RETRY_S = 50_000, 30.0
_DIALECT = pysqlite(paramstyle="named")


def open_engine(location: Path | str) -> Engine:
    """Open or create the database file: WAL, every commit synced."""
    engine = create_engine(
        f"sqlite:///{location}",
        connect_args={"timeout": 10.0, "check_same_thread": False},
        pool_size=8,
        max_overflow=24,
        pool_use_lifo=True,  # the connection that was used last has the most pages in its cache
    )
    event.listen(engine, "connect", _on_connect)
    event.listen(engine, "begin", _on_begin)
    return engine


@contextmanager
def copied(source: Path, target: Path) -> Iterator[Connection]:
    """Copy one committed state of a database that may be in use, and connect to the copy.

    Raises
    ------
    StorageError
        If the source is not a database or the disk is full.
    """
    uri = f"file:{quote(str(source.absolute()))}?mode=ro"
    try:
        with (
            closing(sqlite3.connect(uri, uri=True, timeout=10.0)) as original,
            closing(sqlite3.connect(target)) as copy,
        ):
            original.backup(copy)
            copy.execute("PRAGMA journal_mode=DELETE")  # one file, without a log next to it
        engine = create_engine(f"sqlite:///{target}")
        try:
            with engine.connect() as connection:
                yield connection
        finally:
            engine.dispose()
    except (sqlite3.Error, DatabaseError) as error:
        raise StorageError(f"backup of {source}: {error}") from error


def watch(engine: Engine, *, takes_lease: bool) -> CommitWatch:
    """Return a watch that calls nothing: no other process opens the store."""
    return EmbeddedWatch()


def checkpoint(engine: Engine) -> None:
    """Copy the write-ahead log into the file and truncate it, as far as readers allow.

    Raises
    ------
    StorageError
        If the disk fails; nothing is lost, the log stays.
    """
    connection = engine.raw_connection()
    try:
        connection.cursor().execute("PRAGMA wal_checkpoint(TRUNCATE)")
    except sqlite3.Error as error:
        raise StorageError(f"store: {error}; nothing is lost") from error
    finally:
        connection.close()


def check(connection: Connection) -> list[str]:
    """Return the defects of the file and of the spatial index; empty when there are none."""
    problems = [row[0] for row in connection.execute(text("PRAGMA integrity_check")) if row[0] != "ok"]
    problems += [f"foreign key: {tuple(row)}" for row in connection.execute(text("PRAGMA foreign_key_check"))]
    for index in INDEXES:
        (state,) = connection.execute(text(f"SELECT rtreecheck('{index}')")).one()
        problems += [] if state == "ok" else [f"{index}: {state}"]
    missing = (
        "SELECT count(*) FROM products p WHERE p.deleted_ns IS NULL AND p.xmin_m IS NOT NULL AND NOT EXISTS "
        "(SELECT 1 FROM product_index i WHERE i.id = p.ordinal AND i.x0 <= p.xmin_m AND i.x1 >= p.xmax_m "
        "AND i.y0 <= p.ymin_m AND i.y1 >= p.ymax_m AND i.z0 <= p.zmin_m AND i.z1 >= p.zmax_m)"
    )
    orphaned = "SELECT count(*) FROM product_index WHERE id NOT IN (SELECT ordinal FROM products)"
    for statement, problem in ((missing, "products are not in it"), (orphaned, "entries without a product")):
        (count,) = connection.execute(text(statement)).one()
        problems += [f"spatial index: {count} {problem}"] if count else []
    return problems


def fetch(
    connection: Connection, statement: Select[Any], values: Mapping[str, Any] | None = None
) -> list[Any]:
    """Run a constant statement on the driver; see ``Dialect.fetch``."""
    sql, defaults = _compiled(statement)
    return _driver(connection).execute(sql, {**defaults, **values} if values else defaults).fetchall()


def fetch_ahead(connection: Connection, statements: Sequence[Select[Any]]) -> None:
    """Do nothing: a statement is executed in this process."""


def fetch_together(
    connection: Connection, calls: Sequence[tuple[Select[Any], Mapping[str, Any]]]
) -> list[list[Any]]:
    """Return the rows of several statements with their values; see ``Dialect.fetch_together``."""
    return [fetch(connection, statement, values) for statement, values in calls]


@lru_cache(maxsize=512)
def _compiled(statement: Select[Any]) -> tuple[str, dict[str, Any]]:
    """Return the text of a statement and its parameters."""
    compiled = statement.compile(dialect=_DIALECT)
    return str(compiled), dict(compiled.params)


def elements(name: str, of: type = str) -> Select[Any]:
    """Return a select of the elements of a list parameter."""
    return select(literal_column("value")).select_from(text(f"json_each(:{name})"))


def elements_of(values: Sequence[Any]) -> Select[Any]:
    """Return a select of several values that are bound as one parameter."""
    listed: BindParameter[str] = bindparam("elements", json.dumps(values), unique=True)
    return select(literal_column("value")).select_from(text("json_each(:elements)").bindparams(listed))


def matches(value: ColumnElement[Any], pattern: str) -> ColumnElement[bool]:
    """Return whether a text matches a pattern of ``LIKE``, with its case: the ``LIKE`` of SQLite ignores the
    case.
    """
    glob, escaped = "", False
    for letter in pattern:
        if letter == "\\" and not escaped:
            escaped = True
            continue
        plain = f"[{letter}]" if letter in "*?[" else letter
        glob += plain if escaped else _GLOB.get(letter, plain)
        escaped = False
    return value.bool_op("GLOB")(glob)


@contextmanager
def interruptible(connection: Connection, is_over: Callable[[], bool]) -> Iterator[None]:
    """Interrupt the statements of the block once ``is_over()`` is true; see ``Dialect.interruptible``."""
    driver = _driver(connection)
    driver.set_progress_handler(is_over, _STEPS)
    try:
        yield
    except (sqlite3.OperationalError, DatabaseError) as error:
        if not is_over():
            raise
        raise OverloadedError(
            "the search took too long and was ended: restrict it by type, time or region", _RETRY_S
        ) from error
    finally:
        driver.set_progress_handler(None, 0)


def list_value(elements: Sequence[Any]) -> str:
    """Return the value of a list parameter."""
    return json.dumps(elements)


def listed_products(columns: Sequence[str]) -> Subquery:
    """Return columns of the products whose ordinals are bound to the list parameter ``ordinals``."""
    names = ", ".join(f"products.{name}" for name in columns)
    statement = text(f"SELECT {names} {_LISTED}")
    return statement.columns(*(schema.products.c[name] for name in columns)).subquery("listed_products")


def insert_or_ignore(table: Table) -> Insert:
    """Return an insertion that skips rows whose key exists."""
    return insert(table).on_conflict_do_nothing()


def insert_rows(connection: Connection, table: Table, rows: Sequence[Mapping[str, Any]]) -> None:
    """Insert rows on the driver: a batch has thousands, and SQLAlchemy processes each."""
    _insert(connection, table, rows)


def upsert_rows(
    connection: Connection,
    table: Table,
    rows: Sequence[Mapping[str, Any]],
    *,
    add: Sequence[str] = (),
    replace: Sequence[str] = (),
) -> None:
    """Insert rows that may exist; see ``Dialect.upsert_rows``."""
    changes = [f"{name} = {name} + excluded.{name}" for name in add]
    changes += [f"{name} = coalesce(excluded.{name}, {name})" for name in replace]
    key = ", ".join(column.name for column in table.primary_key)
    update = f"({key}) DO UPDATE SET {', '.join(changes)}" if changes else "DO NOTHING"
    _insert(connection, table, rows, f" ON CONFLICT {update}")


def _insert(
    connection: Connection, table: Table, rows: Sequence[Mapping[str, Any]], on_conflict: str = ""
) -> None:
    if rows:
        placeholders = ", ".join("?" * len(rows[0]))
        statement = f"INSERT INTO {table.name} ({', '.join(rows[0])}) VALUES ({placeholders}){on_conflict}"
        _driver(connection).executemany(statement, [tuple(row.values()) for row in rows])


def index_products(connection: Connection, entries: Iterable[IndexEntry]) -> None:
    """Enter products in the spatial index."""
    rows = [
        (
            ordinal,
            bucket * _BUCKET,
            bucket * _BUCKET + _BUCKET / 2,
            b[0] - _PAD_M,
            b[3] + _PAD_M,
            b[1] - _PAD_M,
            b[4] + _PAD_M,
            b[2] - _PAD_M,
            b[5] + _PAD_M,
            (t_s[0] - _PAD_S) * _PER_S,
            (t_s[1] + _PAD_S) * _PER_S,
        )
        for ordinal, (bucket, b), t_s in entries
    ]
    placeholders = ", ".join("?" * 11)
    _driver(connection).executemany(f"INSERT INTO product_index VALUES ({placeholders})", rows)


def index_deleted(connection: Connection, ordinal: int) -> None:
    """Move a product to the index of deleted products."""
    values = {"id": ordinal}
    connection.execute(text("INSERT INTO deleted_index SELECT * FROM product_index WHERE id = :id"), values)
    connection.execute(text("DELETE FROM product_index WHERE id = :id"), values)


def candidates(index: str) -> Select[Any]:
    """Return a select of the ordinals in an index whose box may overlap one of ``candidate_values``."""
    where = "i.bucket0 <= {0} AND i.bucket1 >= {0}".format(_element(0))
    where += " AND i.t0 <= :candidate_t1 AND i.t1 >= :candidate_t0"
    for axis, (low, high) in zip("xyz", ((1, 4), (2, 5), (3, 6)), strict=True):
        where += f" AND i.{axis}0 <= {_element(high)} AND i.{axis}1 >= {_element(low)}"
    source = text(f"json_each(:candidate_boxes) AS b CROSS JOIN {index} AS i")
    return select(literal_column("i.id")).select_from(source).where(text(where))


def _bucket_position(bucket: int) -> float:
    """Return a position within a bucket along the axis of the buckets of an index."""
    return bucket * _BUCKET + _BUCKET / 4


def candidate_values(boxes: Sequence[IndexBox], t_s: tuple[float, float]) -> dict[str, float | str]:
    """Return the values of the select of ``candidates``: boxes (position of the bucket, then six bounds), and times
    in seconds since the epoch, which may be infinite.
    """
    searched = [[_bucket_position(bucket), *(_clamp_bound(v) for v in box)] for bucket, box in boxes]
    t0, t1 = (_clamp_bound(t * _PER_S) for t in t_s)
    return {"candidate_boxes": json.dumps(searched), "candidate_t0": t0, "candidate_t1": t1}


def candidates_between(
    connection: Connection,
    index: str,
    boxes: Sequence[IndexBox],
    ends_s: tuple[float, float],
    started_before_s: float | None,
    limit: int | None = None,
) -> list[tuple[int, float]]:
    """Return ordinals and end keys of products in an interval of time; see ``Dialect.candidates_between``."""
    low, high = ends_s[0] * _PER_S, (ends_s[1] + _PAD_S) * _PER_S
    latest_start = _LARGEST_BOUND if started_before_s is None else started_before_s * _PER_S
    times = (latest_start, low - _rounding(low), high + _rounding(high))
    statement, driver = _BETWEEN.format(index), _driver(connection)
    rows: list[tuple[int, float]] = []
    for bucket, b in boxes:
        position = _bucket_position(bucket)
        bounds = [_clamp_bound(b[side]) for side in (3, 0, 4, 1, 5, 2)]
        values = (position, position, *bounds, *times, -1 if limit is None else limit + 1)
        rows += driver.execute(statement, values).fetchall()
    return list(set(rows)) if len(boxes) > 1 else rows


def end_bounds_s(end_key: float) -> tuple[float, float]:
    """Return the earliest and latest end of capture of an end key, seconds since the epoch."""
    slack = _rounding(end_key)
    return (end_key - slack) / _PER_S - _PAD_S, (end_key + slack) / _PER_S - _PAD_S


def _driver(connection: Connection) -> sqlite3.Connection:
    driver = connection.connection.driver_connection
    assert isinstance(driver, sqlite3.Connection)
    return driver


def _element(position: int) -> str:
    return f"json_extract(b.value, '$[{position}]')"


def _rounding(value: float) -> float:
    """Return the largest rounding error of a value in the index."""
    return abs(value) * 3e-7 + 1e-6


def _clamp_bound(value: float) -> float:
    """Return the value, with an infinite bound replaced by a finite one, which the index needs."""
    return max(-_LARGEST_BOUND, min(_LARGEST_BOUND, value))


def _on_connect(connection: sqlite3.Connection, _record: object) -> None:
    """Configure a new connection: write-ahead log, synchronous writes, transactions started by
    ``_on_begin``.
    """
    connection.isolation_level = None  # _on_begin starts transactions, not the driver
    for pragma in (
        "journal_mode=WAL",
        "synchronous=FULL",
        "busy_timeout=10000",
        "wal_autocheckpoint=16000",
        "secure_delete=OFF",
    ):
        connection.execute(f"PRAGMA {pragma}")


def _on_begin(connection: Connection) -> None:
    writes = connection.get_execution_options().get(WRITES, False)
    # a batch changes many pages; those of a reader are cached by the operating system
    if connection.info.get(WRITES) != writes:
        connection.info[WRITES] = writes
        connection.exec_driver_sql(f"PRAGMA cache_size=-{_WRITER_KB if writes else _READER_KB}")
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

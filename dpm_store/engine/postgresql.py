# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""PostgreSQL with PostGIS: implementation of ``Dialect`` for several processes on one database.

Writers take one advisory lock, so that ordinals are in the order of commits, as with SQLite, and read all
earlier commits; readers see one snapshot and never wait. The spatial index is a GiST over the bucket (frame
and type) and a line in four dimensions, from the lowest corner and the start of capture to the highest corner
and its end. It compares float32, rounded outwards: the caller compares its results exactly.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import psycopg
from sqlalchemy import (
    ARRAY,
    BigInteger,
    BindParameter,
    ColumnElement,
    Connection,
    Engine,
    Float,
    Select,
    Subquery,
    Table,
    Text,
    bindparam,
    create_engine,
    event,
    func,
    literal_column,
    make_url,
    select,
    text,
)
from sqlalchemy.dialects.postgresql import Insert, insert
from sqlalchemy.dialects.postgresql.psycopg import dialect as psycopg_dialect
from sqlalchemy.exc import DatabaseError

from cdff_common.errors import ConfigurationError, OverloadedError
from dpm_store.engine import schema
from dpm_store.engine.commit_watch import CommitWatch
from dpm_store.engine.dialect import WRITES, IndexBox, IndexEntry
from dpm_store.engine.server_watch import CHANNEL, ServerWatch

FILE_NAME = ""
is_shared = True
Error = psycopg.Error
INDEXES = ("product_index", "deleted_index")
#: Key of the advisory lock of writers ("cdff" in ASCII), and the longest time that a writer waits for it.
WRITER_LOCK, _LOCK_WAIT_MS = 0x63646666, 30_000
#: Settings of every connection: a commit is durable, and short statements are not compiled.
_SETTINGS = f"-c synchronous_commit=on -c jit=off -c lock_timeout={_LOCK_WAIT_MS}"
#: Replaces an infinite bound in the index: float32 can represent it.
_LARGEST_BOUND = 1e30
#: Scale of the time in the index, metres per second: half a minute counts as much as a metre, as in SQLite.
_PER_S = 0.03
#: Extended WKB of a line of two points with z and m.
_LINE, _LINE_TYPE = struct.Struct("<BII8d"), 0xC0000002
_ENTERED = "SELECT bucket, CAST(shape AS geometry) AS shape FROM unnest({}, {}) AS listed(bucket, shape)"
#: The box of each bucket is searched by a scan of the index of its own: the planner would join on the bucket.
_BETWEEN = (
    "SELECT found.ordinal, found.t1_s FROM "
    f"({_ENTERED.format('%(buckets)s::bigint[]', '%(shapes)s::text[]')}) AS box "
    "CROSS JOIN LATERAL (SELECT i.ordinal, i.t1_s FROM {} AS i WHERE i.bucket = box.bucket "
    "AND i.shape &&& box.shape AND i.t1_s >= %(low)s AND i.t1_s <= %(high)s AND i.t0_s <= %(latest)s "
    "LIMIT %(limit)s) AS found"
)
_OVERLAPPING = (
    "({}) AS box CROSS JOIN LATERAL (SELECT i.ordinal FROM {} AS i WHERE i.bucket = box.bucket "
    "AND i.shape &&& box.shape AND i.t0_s <= CAST(:candidate_t1 AS double precision) "
    "AND i.t1_s >= CAST(:candidate_t0 AS double precision) OFFSET 0) AS found"
)
#: From this number of rows on, COPY is faster than INSERT.
_COPIED_ROWS = 20
#: Interval between two checks of the time of a statement, and a time after which a caller may try again.
_CHECK_S, _RETRY_S = 0.02, 30.0
#: Key of the rows that were read ahead in the transaction of a connection.
_AHEAD = "cdff_ahead"
#: Tables whose ordinal is assigned by the database.
_NUMBERED = ("frame_names", "frame_log", "poses", "events", "index_buckets")
_DIALECT = psycopg_dialect()  # type: ignore[no-untyped-call]


def open_engine(location: Path | str) -> Engine:
    """Connect to the database of a URL; every commit is durable.

    Raises
    ------
    ConfigurationError
        If the URL is malformed.
    """
    try:
        url = make_url(str(location))
    except ValueError as error:
        raise ConfigurationError(f"store {location!r}: {error}") from error
    options = " ".join((_SETTINGS, *(v for v in (url.query.get("options"),) if isinstance(v, str))))
    engine = create_engine(
        url.difference_update_query(["options"]),
        connect_args={"options": options, "application_name": "cdff"},
        pool_size=8,
        max_overflow=24,
        pool_use_lifo=True,
    )
    event.listen(engine, "begin", _on_begin)
    return engine


def watch(engine: Engine, *, takes_lease: bool) -> CommitWatch:
    """Follow the commits of all processes with a connection of its own."""
    return ServerWatch(engine, takes_lease=takes_lease)


def checkpoint(engine: Engine) -> None:
    """Do nothing: the server shortens its log by itself."""


def check(connection: Connection) -> list[str]:
    """Return the defects of the spatial index; empty when there are none."""
    problems = []
    missing = (
        "SELECT count(*) FROM products p WHERE p.deleted_ns IS NULL AND p.xmin_m IS NOT NULL AND NOT EXISTS "
        "(SELECT 1 FROM product_index i WHERE i.ordinal = p.ordinal AND i.shape &&& "
        "ST_MakeLine(ST_MakePoint(p.xmin_m, p.ymin_m, p.zmin_m, ST_M(ST_StartPoint(i.shape))), "
        "ST_MakePoint(p.xmax_m, p.ymax_m, p.zmax_m, ST_M(ST_EndPoint(i.shape)))))"
    )
    orphaned = "SELECT count(*) FROM product_index WHERE ordinal NOT IN (SELECT ordinal FROM products)"
    for statement, problem in ((missing, "products are not in it"), (orphaned, "entries without a product")):
        (count,) = connection.execute(text(statement)).one()
        problems += [f"spatial index: {count} {problem}"] if count else []
    return problems


def fetch(
    connection: Connection, statement: Select[Any], values: Mapping[str, Any] | None = None
) -> list[Any]:
    """Run a constant statement on the driver; see ``Dialect.fetch``."""
    if values is None and (known := connection.info.get(_AHEAD)) and statement in known:
        ahead: list[Any] = known.pop(statement)
        return ahead
    rows: list[Any] = _execute(_driver(connection), statement, values).fetchall()
    return rows


def fetch_ahead(connection: Connection, statements: Sequence[Select[Any]]) -> None:
    """Run constant statements in one round trip; see ``Dialect.fetch_ahead``."""
    rows = fetch_together(connection, [(statement, {}) for statement in statements])
    connection.info[_AHEAD] = dict(zip(statements, rows, strict=True))


def fetch_together(
    connection: Connection, calls: Sequence[tuple[Select[Any], Mapping[str, Any]]]
) -> list[list[Any]]:
    """Return the rows of several statements with their values; see ``Dialect.fetch_together``."""
    driver = _driver(connection)
    with driver.pipeline():
        cursors = [_execute(driver, statement, values) for statement, values in calls]
    return [cursor.fetchall() for cursor in cursors]


def _execute(driver: Any, statement: Select[Any], values: Mapping[str, Any] | None) -> Any:
    sql, defaults = _compiled(statement)
    return driver.execute(sql, {**defaults, **values} if values else defaults)


@lru_cache(maxsize=512)
def _compiled(statement: Select[Any]) -> tuple[bytes, dict[str, Any]]:
    """Return the text of a statement and its parameters."""
    compiled = statement.compile(dialect=_DIALECT)
    return str(compiled).encode(), dict(compiled.params)


def elements(name: str, of: type = str) -> Select[Any]:
    """Return a select of the elements of a list parameter."""
    return select(func.unnest(bindparam(name, type_=_array(of))))


def elements_of(values: Sequence[Any]) -> Select[Any]:
    """Return a select of several values that are bound as one parameter."""
    kinds = {type(value) for value in values}
    (kind,) = kinds if len(kinds) == 1 else (float,)
    listed: BindParameter[Any] = bindparam("elements", list(values), type_=_array(kind), unique=True)
    return select(func.unnest(listed))


def _array(of: type) -> ARRAY[Any]:
    return ARRAY({str: Text, int: BigInteger}.get(of, Float(53)))


def matches(value: ColumnElement[Any], pattern: str) -> ColumnElement[bool]:
    """Return whether a text matches a pattern of ``LIKE``, in which a backslash escapes."""
    return value.like(pattern, escape="\\")


@contextmanager
def interruptible(connection: Connection, is_over: Callable[[], bool]) -> Iterator[None]:
    """Cancel the statements of the block once ``is_over()`` is true; see ``Dialect.interruptible``."""
    driver, is_done = _driver(connection), threading.Event()

    def watch() -> None:
        while not is_over():
            if is_done.wait(_CHECK_S):
                return
        while not is_done.is_set():  # one that starts after a cancellation is cancelled too
            driver.cancel_safe(timeout=1.0)
            is_done.wait(_CHECK_S)

    watcher = threading.Thread(target=watch, name="statement time limit", daemon=True)
    watcher.start()
    try:
        yield
    except (psycopg.errors.QueryCanceled, DatabaseError) as error:
        if not is_over():
            raise
        raise OverloadedError(
            "the search took too long and was ended: restrict it by type, time or region", _RETRY_S
        ) from error
    finally:
        is_done.set()
        watcher.join()


def list_value(values: Sequence[Any]) -> list[Any]:
    """Return the value of a list parameter."""
    return list(values)


def listed_products(columns: Sequence[str]) -> Subquery:
    """Return columns of the products whose ordinals are bound to the list parameter ``ordinals``.

    The offset keeps conditions of the query outside: the planner would estimate that an interval of time has
    few products, and read all of the interval instead of the listed ones.
    """
    p = schema.products.c
    ordinals = select(func.unnest(bindparam("ordinals", type_=_array(int))))
    listed = select(*(p[name] for name in columns)).where(p.ordinal.in_(ordinals))
    return listed.offset(literal_column("0")).subquery("listed_products")


def insert_or_ignore(table: Table) -> Insert:
    """Return an insertion that skips rows whose key exists."""
    return insert(table).on_conflict_do_nothing()


def insert_rows(connection: Connection, table: Table, rows: Sequence[Mapping[str, Any]]) -> None:
    """Insert rows on the driver: a batch has thousands, and SQLAlchemy processes each."""
    if len(rows) < _COPIED_ROWS:
        _insert(connection, table, rows)
        return
    names, values = list(rows[0]), [tuple(row.values()) for row in rows]
    if table.name in _NUMBERED and "ordinal" not in names:
        (first,) = connection.exec_driver_sql(f"SELECT coalesce(max(ordinal), 0) + 1 FROM {table.name}").one()
        names, values = ["ordinal", *names], [(first + i, *row) for i, row in enumerate(values)]
    _copy(connection, f"COPY {table.name} ({', '.join(names)}) FROM STDIN", values)


def upsert_rows(
    connection: Connection,
    table: Table,
    rows: Sequence[Mapping[str, Any]],
    *,
    add: Sequence[str] = (),
    replace: Sequence[str] = (),
) -> None:
    """Insert rows that may exist; see ``Dialect.upsert_rows``."""
    changes = [f"{name} = {table.name}.{name} + excluded.{name}" for name in add]
    changes += [f"{name} = coalesce(excluded.{name}, {table.name}.{name})" for name in replace]
    key = ", ".join(column.name for column in table.primary_key)
    update = f"({key}) DO UPDATE SET {', '.join(changes)}" if changes else "DO NOTHING"
    _insert(connection, table, rows, f" ON CONFLICT {update}")


def _insert(
    connection: Connection, table: Table, rows: Sequence[Mapping[str, Any]], on_conflict: str = ""
) -> None:
    if rows:
        placeholders = ", ".join(["%s"] * len(rows[0]))
        statement = f"INSERT INTO {table.name} ({', '.join(rows[0])}) VALUES ({placeholders}){on_conflict}"
        with _driver(connection).cursor() as cursor:
            cursor.executemany(statement.encode(), [tuple(row.values()) for row in rows])


def _copy(connection: Connection, statement: str, rows: Iterable[Sequence[Any]]) -> None:
    with _driver(connection).cursor() as cursor, cursor.copy(statement.encode()) as copy:
        for row in rows:
            copy.write_row(row)


def index_products(connection: Connection, entries: Iterable[IndexEntry]) -> None:
    """Enter products in the spatial index."""
    rows = [(o, bucket, t0_s, t1_s, _shape(box, (t0_s, t1_s))) for o, (bucket, box), (t0_s, t1_s) in entries]
    _copy(connection, "COPY product_index (ordinal, bucket, t0_s, t1_s, shape) FROM STDIN", rows)


def index_deleted(connection: Connection, ordinal: int) -> None:
    """Move a product to the index of deleted products."""
    values = {"id": ordinal}
    moved = "WITH moved AS (DELETE FROM product_index WHERE ordinal = :id RETURNING *) "
    connection.execute(text(f"{moved} INSERT INTO deleted_index SELECT * FROM moved"), values)


def candidates(index: str) -> Select[Any]:
    """Return a select of the ordinals in an index whose box may overlap one of ``candidate_values``."""
    boxes = _ENTERED.format("CAST(:candidate_buckets AS bigint[])", "CAST(:candidate_shapes AS text[])")
    return select(literal_column("found.ordinal")).select_from(text(_OVERLAPPING.format(boxes, index)))


def candidate_values(boxes: Sequence[IndexBox], t_s: tuple[float, float]) -> dict[str, Any]:
    """Return the values of the select of ``candidates``: boxes with their buckets, and times in seconds since
    the epoch, which may be infinite.
    """
    return {
        "candidate_buckets": [bucket for bucket, _ in boxes],
        "candidate_shapes": [_shape(box, t_s) for _, box in boxes],
        "candidate_t0": t_s[0],
        "candidate_t1": t_s[1],
    }


def candidates_between(
    connection: Connection,
    index: str,
    boxes: Sequence[IndexBox],
    ends_s: tuple[float, float],
    started_before_s: float | None,
    limit: int | None = None,
) -> list[tuple[int, float]]:
    """Return ordinals and end keys of products in an interval of time; see ``Dialect.candidates_between``."""
    latest_s = _LARGEST_BOUND if started_before_s is None else started_before_s
    # A product that ends after the earliest end and started before the latest start was made between the two.
    times_s = (ends_s[0], min(ends_s[1], max(ends_s[0], latest_s)))
    values = {
        "buckets": [bucket for bucket, _ in boxes],
        "shapes": [_shape(box, times_s) for _, box in boxes],
        "low": ends_s[0],
        "high": ends_s[1],
        "latest": latest_s,
        "limit": None if limit is None else limit + 1,
    }
    rows = _driver(connection).execute(_BETWEEN.format(index).encode(), values).fetchall()
    return list(set(rows)) if len(boxes) > 1 else rows


def end_bounds_s(end_key: float) -> tuple[float, float]:
    """Return the earliest and latest end of capture of an end key, seconds since the epoch."""
    slack = abs(end_key) * 4e-16 + 1e-9
    return end_key - slack, end_key + slack


def _shape(box: Sequence[float], t_s: Sequence[float]) -> str:
    """Return the extended WKB of the line from the lowest corner and time to the highest, hexadecimal."""
    low = (*box[:3], t_s[0] * _PER_S)
    high = (*box[3:], t_s[1] * _PER_S)
    bounds = (max(-_LARGEST_BOUND, min(_LARGEST_BOUND, value)) for value in (*low, *high))
    return _LINE.pack(1, _LINE_TYPE, 2, *bounds).hex()


def _driver(connection: Connection) -> Any:
    driver: Any = connection.connection.driver_connection
    return driver


def _on_begin(connection: Connection) -> None:
    """Let a reader see one snapshot, and a writer everything that was committed before it got the lock; the
    commit of a writer is notified to all processes.
    """
    connection.info.pop(_AHEAD, None)
    writes = connection.get_execution_options().get(WRITES, False)
    level = psycopg.IsolationLevel.READ_COMMITTED if writes else psycopg.IsolationLevel.REPEATABLE_READ
    driver = _driver(connection)
    if driver.isolation_level is not level:
        driver.isolation_level = level
    if writes:
        driver.execute("SELECT pg_advisory_xact_lock(%s), pg_notify(%s, '')", (WRITER_LOCK, CHANNEL))

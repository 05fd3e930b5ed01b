# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""All that is particular to SQLite: opening, transactions, and the R*Tree. PostgreSQL gets a module like this one.

Transactions are begun by us: SQLAlchemy's default lets two read-modify-writes lose one of them, and a deferred BEGIN
that turns into a write fails in a way no timeout retries. Writers say BEGIN IMMEDIATE, readers take a WAL snapshot.
The R*Tree holds float32, rounded outwards: its answers are candidates, compared exactly by the caller. So that the
rounding stays in millimetres and seconds, boxes are in the product's own frame, and time is relative to an epoch.
Its five dimensions are the bucket (frame and type together), x, y, z and time.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import Connection, Engine, Table, create_engine, event, literal_column, select, text
from sqlalchemy.dialects.sqlite import Insert, insert
from sqlalchemy.sql import Select, Subquery

from cdff_common.errors import StorageError
from dpm_store import schema
from dpm_store.packs import Span, merged

#: Execution option that says a connection is going to write.
WRITES = "cdff_writes"
#: What the engine raises by itself.
Error = sqlite3.Error
#: Pages kept in memory by a connection while it writes, and while it reads.
_WRITER_KB, _READER_KB = 65536, 4096
#: Largest offset that stands for "no bound" in the index: float32 keeps it.
_FAR = 1e30

#: A box as the index names it: ordinal of the bucket (frame and type), then metres in the frame.
IndexBox = tuple[int, Sequence[float]]
INDEXES = ("product_index", "deleted_index")
#: How the index counts. Splits of an R*Tree weigh volumes and sums of sides: no side may be 0, buckets must lie far
#: apart, and half a minute counts as much as a metre. Measured in ADR 6.
_BUCKET, _PAD_M, _PAD_S, _PER_S = 65536.0, 0.05, 0.5, 0.03
_BETWEEN = (
    "SELECT id, t1 FROM {} WHERE f0 <= ? AND f1 >= ? AND x0 <= ? AND x1 >= ? AND y0 <= ? AND y1 >= ? "
    "AND z0 <= ? AND z1 >= ? AND t0 <= ? AND t1 >= ? AND t1 <= ? LIMIT ?"
)
#: Products one by one, by their ordinals alone; only the value keeps the name of a column of the list's.
_LISTED = (
    "FROM (SELECT value FROM json_each(:ordinals)) AS listed "
    "CROSS JOIN products NOT INDEXED ON products.ordinal = listed.value"
)
#: Run by the migrations after the tables are made.
DDL = (
    "CREATE VIRTUAL TABLE product_index USING rtree(id, f0, f1, x0, x1, y0, y1, z0, z1, t0, t1)",
    *(
        f"CREATE TRIGGER {table}_refuse_{verb.lower()} BEFORE {verb} ON {table} "
        f"BEGIN SELECT RAISE(ABORT, '{table} are append-only'); END"
        for table in ("events", "frames")
        for verb in ("UPDATE", "DELETE")
    ),
)
#: The same for revision 0002.
DDL_ANNOTATIONS = tuple(
    f"CREATE TRIGGER annotations_refuse_{verb.lower()} BEFORE {verb} ON annotations "
    "BEGIN SELECT RAISE(ABORT, 'annotations are append-only'); END"
    for verb in ("UPDATE", "DELETE")
)
#: The same for revision 0003: deleted products move to an index of their own, for questions of what was known then.
DDL_0003 = (
    "CREATE VIRTUAL TABLE deleted_index USING rtree(id, f0, f1, x0, x1, y0, y1, z0, z1, t0, t1)",
    "INSERT INTO deleted_index "
    "SELECT p.ordinal, n.ordinal, n.ordinal, p.xmin_m, p.xmax_m, p.ymin_m, p.ymax_m, p.zmin_m, p.zmax_m, "
    "(p.t0_ns - e.value) / 1e9, (p.t1_ns - e.value) / 1e9 "
    "FROM products p JOIN frame_names n ON n.frame = p.frame JOIN meta e ON e.name = 'epoch_ns' "
    "WHERE p.deleted_ns IS NOT NULL AND p.xmin_m IS NOT NULL",
    *(
        f"CREATE TRIGGER {table}_refuse_{verb.lower()} BEFORE {verb} ON {table} "
        f"BEGIN SELECT RAISE(ABORT, '{table} are append-only'); END"
        for table in ("bodies", "frame_log")
        for verb in ("UPDATE", "DELETE")
    ),
)

#: The same for revision 0004: sums that follow every change of ``products`` and ``blobs``, whoever makes it.
_ADD_PRODUCT = (
    "INSERT INTO tallies VALUES (NEW.robot, NEW.product, 1, NEW.size) "
    "ON CONFLICT DO UPDATE SET live = live + 1, bytes = bytes + NEW.size"
)
_SUBTRACT_PRODUCT = (
    "UPDATE tallies SET live = live - 1, bytes = bytes - OLD.size WHERE robot = OLD.robot AND product = OLD.product"
)
_REFILL = (
    f"INSERT INTO {{}} SELECT p.ordinal, b.ordinal * {_BUCKET}, b.ordinal * {_BUCKET} + {_BUCKET / 2}, "
    f"p.xmin_m - {_PAD_M}, p.xmax_m + {_PAD_M}, p.ymin_m - {_PAD_M}, p.ymax_m + {_PAD_M}, "
    f"p.zmin_m - {_PAD_M}, p.zmax_m + {_PAD_M}, "
    f"((p.t0_ns - e.value) / 1e9 - {_PAD_S}) * {_PER_S}, ((p.t1_ns - e.value) / 1e9 + {_PAD_S}) * {_PER_S} "
    "FROM products p JOIN frame_names n ON n.frame = p.frame "
    "JOIN index_buckets b ON b.frame = n.ordinal AND b.product = p.product JOIN meta e ON e.name = 'epoch_ns' "
    "WHERE p.xmin_m IS NOT NULL AND p.deleted_ns IS {}"
)
DDL_0004 = (
    "INSERT INTO index_buckets (frame, product) SELECT DISTINCT n.ordinal, p.product FROM products p "
    "JOIN frame_names n ON n.frame = p.frame",
    "DELETE FROM product_index",
    "DELETE FROM deleted_index",
    _REFILL.format("product_index", "NULL"),
    _REFILL.format("deleted_index", "NOT NULL"),
    "INSERT INTO tallies SELECT robot, product, count(*), sum(size) FROM products WHERE deleted_ns IS NULL "
    "GROUP BY robot, product",
    "INSERT INTO blob_tallies SELECT content IS NOT NULL, count(*), sum(size) FROM blobs GROUP BY content IS NOT NULL",
    f"CREATE TRIGGER products_add AFTER INSERT ON products WHEN NEW.deleted_ns IS NULL BEGIN {_ADD_PRODUCT}; END",
    "CREATE TRIGGER products_delete AFTER UPDATE OF deleted_ns ON products "
    f"WHEN OLD.deleted_ns IS NULL AND NEW.deleted_ns IS NOT NULL BEGIN {_SUBTRACT_PRODUCT}; END",
    "CREATE TRIGGER products_purge AFTER DELETE ON products WHEN OLD.deleted_ns IS NULL "
    f"BEGIN {_SUBTRACT_PRODUCT}; END",
    "CREATE TRIGGER blobs_add AFTER INSERT ON blobs BEGIN "
    "INSERT INTO blob_tallies VALUES (NEW.content IS NOT NULL, 1, NEW.size) "
    "ON CONFLICT DO UPDATE SET payloads = payloads + 1, bytes = bytes + NEW.size; END",
    "CREATE TRIGGER blobs_remove AFTER DELETE ON blobs BEGIN "
    "UPDATE blob_tallies SET payloads = payloads - 1, bytes = bytes - OLD.size "
    "WHERE inline = (OLD.content IS NOT NULL); END",
)
#: The same for revision 0005, once contents are in packs: sums go by the place, payloads count the products that have
#: them. What is added is summed by whoever adds it (``count_products``).
DDL_0005_FIRST = tuple(f"DROP TRIGGER {name}" for name in ("blobs_add", "blobs_remove", "products_add"))
DDL_0005 = (
    "UPDATE blobs SET live = (SELECT count(*) FROM products p WHERE p.sha256 = blobs.sha256 AND p.deleted_ns IS NULL)",
    "DROP INDEX products_by_blob",
    "CREATE TRIGGER blobs_remove AFTER DELETE ON blobs BEGIN "
    "UPDATE blob_tallies SET payloads = payloads - 1, bytes = bytes - OLD.size "
    "WHERE inline = (OLD.place IS NOT NULL); END",
    "CREATE TRIGGER products_leave AFTER UPDATE OF deleted_ns ON products "
    "WHEN OLD.deleted_ns IS NULL AND NEW.deleted_ns IS NOT NULL "
    "BEGIN UPDATE blobs SET live = live - 1 WHERE sha256 = OLD.sha256; END",
)


def open_engine(path: Path) -> Engine:
    """Open or make the database file: WAL, every commit synced."""
    engine = create_engine(
        f"sqlite:///{path}",
        connect_args={"timeout": 10.0, "check_same_thread": False},
        pool_size=8,
        max_overflow=24,
        pool_use_lifo=True,  # the one used last has the most pages in its cache
    )
    event.listen(engine, "connect", _on_connect)
    event.listen(engine, "begin", _on_begin)
    return engine


def copy_database(source: Path, target: Path) -> tuple[int, list[str], list[Span]]:
    """Copy one committed state of a database that may be in use.

    Returns
    -------
    tuple of int, list of str, list of Span
        Live products in it, the digests of the payloads that lie in files, and what is used of packs.

    Raises
    ------
    StorageError
        If the source is no sound database or the disk is full.
    """
    try:
        with (
            closing(sqlite3.connect(f"file:{quote(str(source.absolute()))}?mode=ro", uri=True, timeout=10.0)) as there,
            closing(sqlite3.connect(target)) as here,
        ):
            there.backup(here)
            here.execute("PRAGMA journal_mode=DELETE")  # one file, nothing beside it
            (products,) = here.execute("SELECT count(*) FROM products WHERE deleted_ns IS NULL").fetchone()
            named = here.execute("SELECT sha256 FROM blobs WHERE place IS NULL ORDER BY sha256")
            digests = [row[0] for row in named]
            packed = here.execute("SELECT place, size FROM blobs WHERE place IS NOT NULL ORDER BY place")
            return int(products), digests, merged(packed)
    except sqlite3.Error as error:
        raise StorageError(f"backup of {source}: {error}") from error


def contents(connection: Connection, most: int) -> Iterator[list[tuple[int, bytes]]]:
    """Row numbers and contents of the payloads that lie in the database up to revision 0004, some at a time."""
    statement, last = (
        "SELECT rowid, content FROM blobs WHERE rowid > ? AND content IS NOT NULL ORDER BY rowid LIMIT ?",
        0,
    )
    while found := _driver(connection).execute(statement, (last, most)).fetchall():
        yield found
        last = found[-1][0]


def place_contents(connection: Connection, placed: Iterable[tuple[int, int]]) -> None:
    """Say where contents lie now, place and row number of each; they are no longer in the database."""
    _driver(connection).executemany("UPDATE blobs SET place = ?, content = NULL WHERE rowid = ?", placed)


def directory(connection: Connection) -> Path:
    """Where the database's file is."""
    (_, _, path) = _driver(connection).execute("PRAGMA database_list").fetchone()
    return Path(path).parent


def shrink(engine: Engine) -> None:
    """Write the file anew where more than half of it is free, if there is room for that.

    Raises
    ------
    StorageError
        If the disk is full or fails; the file stays as it was.
    """
    with _outside_transactions(engine) as cursor:
        free, pages = (cursor.execute(f"PRAGMA {name}").fetchone()[0] for name in ("freelist_count", "page_count"))
        if 2 * free > pages:
            cursor.execute("VACUUM")


def fold_log(engine: Engine) -> None:
    """Carry the write-ahead log over into the file and cut it to nothing, as far as readers let it.

    Raises
    ------
    StorageError
        If the disk fails; nothing is lost, the log stays.
    """
    with _outside_transactions(engine) as cursor:
        cursor.execute("PRAGMA wal_checkpoint(TRUNCATE)")


@contextmanager
def _outside_transactions(engine: Engine) -> Iterator[Any]:
    connection = engine.raw_connection()
    try:
        yield connection.cursor()
    except sqlite3.Error as error:
        raise StorageError(f"store: {error}; nothing is lost") from error
    finally:
        connection.close()


def insert_new(table: Table) -> Insert:
    """An insertion that leaves rows alone whose key is there already."""
    return insert(table).on_conflict_do_nothing()


def insert_rows(connection: Connection, table: Table, rows: Sequence[Mapping[str, Any]]) -> None:
    """Insert rows that name the same columns in one order: a batch has thousands, and SQLAlchemy would look at each."""
    _insert_rows(connection, table, rows, "")


def insert_blobs(connection: Connection, rows: Sequence[Mapping[str, Any]]) -> None:
    """Insert payloads; one that is there already has so many products more, and lies where the row says if it does."""
    more = "DO UPDATE SET live = live + excluded.live, place = coalesce(excluded.place, place)"
    _insert_rows(connection, schema.blobs, rows, f"ON CONFLICT (sha256) {more}")


def count_products(connection: Connection, sizes: Iterable[tuple[str, str, int]]) -> None:
    """Add products to the sums: robot, type and bytes of each. A trigger for each of them takes longer than its row."""
    _count(connection, "tallies", "live", [((robot, product), size) for robot, product, size in sizes])


def count_blobs(connection: Connection, sizes: Iterable[tuple[bool, int]]) -> None:
    """Add payloads to the sums: whether it is in a pack, and bytes, of each."""
    _count(connection, "blob_tallies", "payloads", [((int(packed),), size) for packed, size in sizes])


def _count(connection: Connection, table: str, column: str, sizes: Sequence[tuple[tuple[Any, ...], int]]) -> None:
    sums: dict[tuple[Any, ...], tuple[int, int]] = {}
    for key, size in sizes:
        count, total = sums.get(key, (0, 0))
        sums[key] = count + 1, total + size
    rows = [(*key, count, total) for key, (count, total) in sums.items()]
    if rows:
        statement = (
            f"INSERT INTO {table} VALUES ({', '.join('?' * len(rows[0]))}) ON CONFLICT DO UPDATE "
            f"SET {column} = {column} + excluded.{column}, bytes = bytes + excluded.bytes"
        )
        _driver(connection).executemany(statement, rows)


def placed(connection: Connection, digests: Sequence[str]) -> dict[str, int | None]:
    """Where payloads lie that are there: their places in packs, None for those in files."""
    statement = "SELECT sha256, place FROM blobs WHERE sha256 IN (SELECT value FROM json_each(?))"
    return dict(_driver(connection).execute(statement, (json.dumps(digests),)).fetchall())


def spans(connection: Connection, first: int, end: int) -> list[Span]:
    """Places and sizes of the payloads whose place is at or after the first and before the end, in order."""
    statement = "SELECT place, size FROM blobs WHERE place >= ? AND place < ? ORDER BY place"
    return _driver(connection).execute(statement, (first, end)).fetchall()


def _insert_rows(connection: Connection, table: Table, rows: Sequence[Mapping[str, Any]], conflict: str) -> None:
    if rows:
        places = ", ".join("?" * len(rows[0]))
        statement = f"INSERT INTO {table.name} ({', '.join(rows[0])}) VALUES ({places}) {conflict}"
        _driver(connection).executemany(statement, [tuple(row.values()) for row in rows])


def index_products(connection: Connection, entries: Iterable[tuple[int, IndexBox, tuple[float, float]]]) -> None:
    """Enter products: ordinal, box, begin and end of capture in seconds since the epoch."""
    rows = [
        (
            ordinal, bucket * _BUCKET, bucket * _BUCKET + _BUCKET / 2, b[0] - _PAD_M, b[3] + _PAD_M, b[1] - _PAD_M,
            b[4] + _PAD_M, b[2] - _PAD_M, b[5] + _PAD_M, (t_s[0] - _PAD_S) * _PER_S, (t_s[1] + _PAD_S) * _PER_S,
        )
        for ordinal, (bucket, b), t_s in entries
    ]  # fmt: skip
    _driver(connection).executemany("INSERT INTO product_index VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", rows)


def unindex_product(connection: Connection, ordinal: int) -> None:
    """Move a deleted product to the index of deleted ones."""
    values = {"id": ordinal}
    connection.execute(text("INSERT INTO deleted_index SELECT * FROM product_index WHERE id = :id"), values)
    connection.execute(text("DELETE FROM product_index WHERE id = :id"), values)


def ends_of_capture(connection: Connection) -> tuple[int, int]:
    """First and last end of capture of all products that were ever inserted; (0, -1) without any."""
    ends = "SELECT (SELECT min(t1_ns) FROM products), (SELECT max(t1_ns) FROM products)"
    first, last = _driver(connection).execute(ends).fetchone()
    return (0, -1) if first is None else (first, last)


def candidates_between(
    connection: Connection,
    index: str,
    boxes: Sequence[IndexBox],
    ends_s: tuple[float, float],
    began_s: float | None,
    most: int | None = None,
) -> list[tuple[int, float]]:
    """Ordinals in an index whose box may overlap one of these, and when each ended as the index counts (``ended_s``).

    Parameters
    ----------
    ends_s : tuple of 2 float
        Between which the capture ended, seconds since the epoch; some just outside are named too.
    began_s : float or None
        Before which it began.
    most : int, optional
        Of each box no more are named than one over this.
    """
    low, high = ends_s[0] * _PER_S, (ends_s[1] + _PAD_S) * _PER_S
    times = (_FAR if began_s is None else began_s * _PER_S, low - _rounding(low), high + _rounding(high))
    statement, driver = _BETWEEN.format(index), _driver(connection)
    found: list[tuple[int, float]] = []
    for bucket, b in boxes:
        middle = bucket * _BUCKET + _BUCKET / 4
        sides = (_kept(b[3]), _kept(b[0]), _kept(b[4]), _kept(b[1]), _kept(b[5]), _kept(b[2]))
        values = (middle, middle, *sides, *times, -1 if most is None else most + 1)
        found += driver.execute(statement, values).fetchall()
    return list(set(found)) if len(boxes) > 1 else found


def ended_s(counted: float) -> tuple[float, float]:
    """Not before and not after when a capture ended, seconds since the epoch, of the end as the index counts it."""
    slack = _rounding(counted)
    return (counted - slack) / _PER_S - _PAD_S, (counted + slack) / _PER_S - _PAD_S


def listed_products(columns: Sequence[str]) -> Subquery:
    """Products whose ordinals are in the parameter ``ordinals`` (see ``list_value``), with some of their columns.

    They are looked up one by one: to SQLite, an index of ``products`` by anything else would look as good, and is not.
    """
    names = ", ".join(f"products.{name}" for name in columns)
    statement = text(f"SELECT {names} {_LISTED}")
    return statement.columns(*(schema.products.c[name] for name in columns)).subquery("listed_products")


def listed_rows(
    connection: Connection, columns: Sequence[str], where: Sequence[str], order: str, values: Mapping[str, Any]
) -> list[tuple[Any, ...]]:
    """Rows of ``products`` whose ordinals are listed in ``values["ordinals"]``; conditions and order as text."""
    return (
        _driver(connection)
        .execute(
            f"SELECT {', '.join(columns)} {_LISTED} WHERE {' AND '.join(where)} ORDER BY {order}",
            dict(values),
        )
        .fetchall()
    )


def buckets(connection: Connection) -> list[tuple[int, int, str]]:
    """Ordinal, ordinal of the frame, and type of every bucket of the index."""
    return _driver(connection).execute("SELECT ordinal, frame, product FROM index_buckets").fetchall()


def frames_of_products(connection: Connection) -> list[tuple[int, str, float | None, float | None]]:
    """Ordinal, name, and lowest and highest z of every frame that ever held products, by name."""
    statement = "SELECT ordinal, frame, zmin_m, zmax_m FROM frame_names ORDER BY frame"
    return _driver(connection).execute(statement).fetchall()


def newest_frame_revision(connection: Connection) -> int:
    """Number of the newest revision of any frame, 0 without any."""
    (newest,) = _driver(connection).execute("SELECT max(ordinal) FROM frame_log").fetchone()
    return newest or 0


def rings(connection: Connection, ordinals: Iterable[int]) -> list[tuple[int, bytes]]:
    """Ordinal and ring of the products that have a footprint."""
    statement = "SELECT ordinal, ring FROM footprints WHERE ordinal IN (SELECT value FROM json_each(?))"
    return _driver(connection).execute(statement, (list_value(list(ordinals)),)).fetchall()


def _driver(connection: Connection) -> sqlite3.Connection:
    """The engine's own connection, for the few statements of every search: SQLAlchemy takes longer than they do."""
    driver = connection.connection.driver_connection
    assert isinstance(driver, sqlite3.Connection)
    return driver


def list_value(numbers: Sequence[int]) -> str:
    """A value for the parameter of ``listed_products``."""
    return json.dumps(numbers)


def candidates(index: str) -> Select[Any]:
    """A subquery of the ordinals in an index whose box may overlap one of those bound by ``candidate_values``."""
    where = "i.f0 <= {0} AND i.f1 >= {0}".format(_side(0))
    where += " AND i.t0 <= :candidate_t1 AND i.t1 >= :candidate_t0"
    for axis, (low, high) in zip("xyz", ((1, 4), (2, 5), (3, 6)), strict=True):
        where += f" AND i.{axis}0 <= {_side(high)} AND i.{axis}1 >= {_side(low)}"
    source = text(f"json_each(:candidate_boxes) AS b CROSS JOIN {index} AS i")
    return select(literal_column("i.id")).select_from(source).where(text(where))


def candidate_values(boxes: Sequence[IndexBox], t_s: tuple[float, float]) -> dict[str, float | str]:
    """Values for ``candidates``; seconds since the epoch, may be infinite."""
    places = [[bucket * _BUCKET + _BUCKET / 4, *(_kept(v) for v in box)] for bucket, box in boxes]
    t0, t1 = (_kept(t * _PER_S) for t in t_s)
    return {"candidate_boxes": json.dumps(places), "candidate_t0": t0, "candidate_t1": t1}


def _side(place: int) -> str:
    return f"json_extract(b.value, '$[{place}]')"


def _rounding(value: float) -> float:
    """By how much the index may have rounded a value, at most."""
    return abs(value) * 3e-7 + 1e-6


def check(connection: Connection) -> list[str]:
    """Problems that the engine itself finds in its file; empty when it is sound."""
    problems = [row[0] for row in connection.execute(text("PRAGMA integrity_check")) if row[0] != "ok"]
    problems += [f"foreign key: {tuple(row)}" for row in connection.execute(text("PRAGMA foreign_key_check"))]
    for index in INDEXES:
        (state,) = connection.execute(text(f"SELECT rtreecheck('{index}')")).one()
        problems += [] if state == "ok" else [f"{index}: {state}"]
    (lost,) = connection.execute(
        text(
            "SELECT count(*) FROM products p WHERE p.deleted_ns IS NULL AND p.xmin_m IS NOT NULL "
            "AND NOT EXISTS (SELECT 1 FROM product_index i WHERE i.id = p.ordinal AND i.x0 <= p.xmin_m AND "
            "i.x1 >= p.xmax_m AND i.y0 <= p.ymin_m AND i.y1 >= p.ymax_m AND i.z0 <= p.zmin_m AND i.z1 >= p.zmax_m)"
        )
    ).one()
    (extra,) = connection.execute(
        text("SELECT count(*) FROM product_index i WHERE NOT EXISTS (SELECT 1 FROM products p WHERE p.ordinal = i.id)")
    ).one()
    problems += [f"spatial index: {lost} products are not in it"] if lost else []
    problems += [f"spatial index: {extra} entries without a product"] if extra else []
    (differing,) = connection.execute(
        text(
            "SELECT count(*) FROM (SELECT robot, product, live, bytes FROM tallies WHERE live <> 0 EXCEPT "
            "SELECT robot, product, count(*), sum(size) FROM products WHERE deleted_ns IS NULL GROUP BY robot, product)"
        )
    ).one()
    problems += [f"sums: {differing} differ from what is there"] if differing else []
    (miscounted,) = connection.execute(
        text(
            "SELECT count(*) FROM (SELECT sha256, live FROM blobs WHERE live <> 0 EXCEPT SELECT sha256, count(*) "
            "FROM products WHERE deleted_ns IS NULL GROUP BY sha256)"
        )
    ).one()
    problems += [f"payloads: {miscounted} have other products than they count"] if miscounted else []
    (other,) = connection.execute(
        text(
            "SELECT count(*) FROM (SELECT inline, payloads, bytes FROM blob_tallies WHERE payloads <> 0 EXCEPT "
            "SELECT place IS NOT NULL, count(*), sum(size) FROM blobs GROUP BY 1)"
        )
    ).one()
    return problems + ([f"sums: {other} of payloads differ from what is there"] if other else [])


def _kept(value: float) -> float:
    return max(-_FAR, min(_FAR, value))


def _on_connect(connection: sqlite3.Connection, _record: object) -> None:
    connection.isolation_level = None  # begun by _on_begin, not by the driver
    for pragma in (
        "journal_mode=WAL", "synchronous=FULL", "busy_timeout=10000", "wal_autocheckpoint=16000", "secure_delete=OFF",
    ):  # fmt: skip
        connection.execute(f"PRAGMA {pragma}")


def _on_begin(connection: Connection) -> None:
    writes = connection.get_execution_options().get(WRITES, False)
    if (
        connection.info.get(WRITES) != writes
    ):  # a batch changes many pages; a reader's are as near in the system's cache
        connection.info[WRITES] = writes
        connection.exec_driver_sql(f"PRAGMA cache_size=-{_WRITER_KB if writes else _READER_KB}")
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

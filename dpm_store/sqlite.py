# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""All that is particular to SQLite: opening, transactions, and the R*Tree. PostgreSQL gets a module like this one.

Transactions are begun by us: SQLAlchemy's default lets two read-modify-writes lose one of them, and a deferred BEGIN
that turns into a write fails in a way no timeout retries. Writers say BEGIN IMMEDIATE, readers take a WAL snapshot.
The R*Tree holds float32, rounded outwards: its answers are candidates, compared exactly by the caller. So that the
rounding stays in millimetres and seconds, boxes are in the product's own frame, and time is relative to an epoch.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import Connection, Engine, Table, create_engine, event, literal_column, select, text
from sqlalchemy.dialects.sqlite import Insert, insert
from sqlalchemy.sql import Select

from cdff_common.errors import StorageError

#: Execution option that says a connection is going to write.
WRITES = "cdff_writes"
#: Largest offset that stands for "no bound" in the index: float32 keeps it.
_FAR = 1e30

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
DDL_0004 = (
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


def open_engine(path: Path) -> Engine:
    """Open or make the database file: WAL, every commit synced, foreign keys on."""
    engine = create_engine(
        f"sqlite:///{path}",
        connect_args={"timeout": 10.0, "check_same_thread": False},
        pool_size=8,
        max_overflow=24,
    )
    event.listen(engine, "connect", _on_connect)
    event.listen(engine, "begin", _on_begin)
    return engine


def copy_database(source: Path, target: Path) -> tuple[int, list[str]]:
    """Copy one committed state of a database that may be in use.

    Returns
    -------
    tuple of int and list of str
        Live products in it, and the digests of the payloads that lie in files.

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
            named = here.execute("SELECT sha256 FROM blobs WHERE content IS NULL AND size > 0 ORDER BY sha256")
            return int(products), [row[0] for row in named]
    except sqlite3.Error as error:
        raise StorageError(f"backup of {source}: {error}") from error


def reusable_bytes(engine: Engine) -> int:
    """Bytes inside the database's file that are free: deletions leave them to later insertions."""
    with engine.connect() as connection:
        pages, size = (
            connection.exec_driver_sql(f"PRAGMA {name}").scalar_one() for name in ("freelist_count", "page_size")
        )
        return int(pages) * int(size)


def fold_log(engine: Engine) -> None:
    """Carry the write-ahead log over into the file and cut it to nothing, as far as readers let it."""
    connection = engine.raw_connection()
    try:
        connection.cursor().execute("PRAGMA wal_checkpoint(TRUNCATE)")
    finally:
        connection.close()


def insert_new(table: Table) -> Insert:
    """An insertion that leaves rows alone whose key is there already."""
    return insert(table).on_conflict_do_nothing()


def index_product(
    connection: Connection, ordinal: int, frame: int, box_m: Sequence[float], t_s: tuple[float, float]
) -> None:
    """Enter a product: ordinal of its frame, ``xmin ymin zmin xmax ymax zmax`` in it, seconds since the epoch."""
    connection.execute(
        text("INSERT INTO product_index VALUES (:id, :f, :f, :x0, :x1, :y0, :y1, :z0, :z1, :t0, :t1)"),
        {
            "id": ordinal, "f": frame, "t0": t_s[0], "t1": t_s[1], "x0": box_m[0], "x1": box_m[3], "y0": box_m[1],
            "y1": box_m[4], "z0": box_m[2], "z1": box_m[5],
        },
    )  # fmt: skip


def unindex_product(connection: Connection, ordinal: int) -> None:
    """Move a deleted product to the index of deleted ones."""
    values = {"id": ordinal}
    connection.execute(text("INSERT INTO deleted_index SELECT * FROM product_index WHERE id = :id"), values)
    connection.execute(text("DELETE FROM product_index WHERE id = :id"), values)


def candidates(
    frame: int, box_m: Sequence[float], t_s: tuple[float, float], prefix: str
) -> tuple[Select[Any], dict[str, float]]:
    """A subquery of the ordinals whose indexed box may overlap, and its bound values.

    Parameters
    ----------
    frame : int
        Ordinal of the frame.
    box_m : sequence of 6 float
        In that frame, metres; may be infinite.
    t_s : tuple of 2 float
        Seconds since the epoch; may be infinite.
    prefix : str
        Of the parameters' names, so that several subqueries fit in one statement.
    """
    values = {
        f"{prefix}f": float(frame), f"{prefix}x0": _kept(box_m[0]), f"{prefix}x1": _kept(box_m[3]),
        f"{prefix}y0": _kept(box_m[1]), f"{prefix}y1": _kept(box_m[4]), f"{prefix}z0": _kept(box_m[2]),
        f"{prefix}z1": _kept(box_m[5]), f"{prefix}t0": _kept(t_s[0]), f"{prefix}t1": _kept(t_s[1]),
    }  # fmt: skip
    where = " AND ".join(
        [f"f0 <= :{prefix}f AND f1 >= :{prefix}f", f"t0 <= :{prefix}t1 AND t1 >= :{prefix}t0"]
        + [f"{axis}0 <= :{prefix}{axis}1 AND {axis}1 >= :{prefix}{axis}0" for axis in "xyz"]
    )
    return select(literal_column("id")).select_from(text("product_index")).where(text(where)), values


def frame_bounds(connection: Connection, frame: int) -> tuple[float, float] | None:
    """Lowest and highest indexed z of a frame's products, or None where it has none."""
    low, high = connection.execute(
        text("SELECT min(z0), max(z1) FROM product_index WHERE f0 <= :f AND f1 >= :f"), {"f": frame}
    ).one()
    return None if low is None else (low, high)


def check(connection: Connection) -> list[str]:
    """Problems that the engine itself finds in its file; empty when it is sound."""
    problems = [row[0] for row in connection.execute(text("PRAGMA integrity_check")) if row[0] != "ok"]
    problems += [f"foreign key: {tuple(row)}" for row in connection.execute(text("PRAGMA foreign_key_check"))]
    (index_state,) = connection.execute(text("SELECT rtreecheck('product_index')")).one()
    problems += [] if index_state == "ok" else [f"spatial index: {index_state}"]
    (lost,) = connection.execute(
        text(
            "SELECT count(*) FROM products p WHERE p.deleted_ns IS NULL AND p.xmin_m IS NOT NULL "
            "AND NOT EXISTS (SELECT 1 FROM product_index i WHERE i.id = p.ordinal)"
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
    return problems + ([f"sums: {differing} differ from what is there"] if differing else [])


def _kept(value: float) -> float:
    return max(-_FAR, min(_FAR, value))


def _on_connect(connection: sqlite3.Connection, _record: object) -> None:
    connection.isolation_level = None  # begun by _on_begin, not by the driver
    for pragma in (
        "journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON", "busy_timeout=10000", "cache_size=-32768",
        "wal_autocheckpoint=4000", "temp_store=MEMORY",
    ):  # fmt: skip
        connection.execute(f"PRAGMA {pragma}")


def _on_begin(connection: Connection) -> None:
    writes = connection.get_execution_options().get(WRITES, False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

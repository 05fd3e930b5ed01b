# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""All that is particular to SQLite: opening, transactions, and the R*Tree. PostgreSQL gets a module like this one.

Transactions are begun by us: SQLAlchemy's default lets two read-modify-writes lose one of them, and a deferred BEGIN
that turns into a write fails in a way no timeout retries. Writers say BEGIN IMMEDIATE, readers take a WAL snapshot.
The R*Tree holds float32, rounded outwards: its answers are candidates, compared exactly by the caller. So that the
rounding stays in millimetres and seconds, boxes are in the product's own frame, and time is relative to an epoch.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import Connection, Engine, Table, create_engine, event, literal_column, select, text
from sqlalchemy.dialects.sqlite import Insert, insert
from sqlalchemy.sql import Select

from cdff_common.errors import StorageError
from dpm_store import schema

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


def insert_blobs() -> Insert:
    """An insertion of payloads; one that lies in the database already is mended where it is not what it was."""
    statement = insert(schema.blobs)
    kept, given = schema.blobs.c.content, statement.excluded.content
    return statement.on_conflict_do_update(
        index_elements=["sha256"], set_={"content": given}, where=kept.is_not(None) & (kept != given)
    )


def index_products(
    connection: Connection, entries: Iterable[tuple[int, int, Sequence[float], tuple[float, float]]]
) -> None:
    """Enter products: ordinal, that of the frame, ``xmin ymin zmin xmax ymax zmax`` in it, seconds since the epoch."""
    rows = [
        (ordinal, f, f, b[0], b[3], b[1], b[4], b[2], b[5], t_s[0], t_s[1]) for ordinal, f, b, t_s in entries
    ]  # fmt: skip
    connection.exec_driver_sql("INSERT INTO product_index VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)", rows)


def unindex_product(connection: Connection, ordinal: int) -> None:
    """Move a deleted product to the index of deleted ones."""
    values = {"id": ordinal}
    connection.execute(text("INSERT INTO deleted_index SELECT * FROM product_index WHERE id = :id"), values)
    connection.execute(text("DELETE FROM product_index WHERE id = :id"), values)


def candidates(index: str) -> Select[Any]:
    """A subquery of the ordinals in an index whose box may overlap one of those bound by ``candidate_values``."""
    where = "i.f0 <= {0} AND i.f1 >= {0}".format(_side(0))
    where += " AND i.t0 <= :candidate_t1 AND i.t1 >= :candidate_t0"
    for axis, (low, high) in zip("xyz", ((1, 4), (2, 5), (3, 6)), strict=True):
        where += f" AND i.{axis}0 <= {_side(high)} AND i.{axis}1 >= {_side(low)}"
    source = text(f"json_each(:candidate_boxes) AS b CROSS JOIN {index} AS i")
    return select(literal_column("i.id")).select_from(source).where(text(where))


def candidate_values(
    boxes: Sequence[tuple[int, Sequence[float]]], t_s: tuple[float, float]
) -> dict[str, float | str]:
    """Values for ``candidates``.

    Parameters
    ----------
    boxes : sequence of (int, 6 floats)
        Ordinal of a frame and a box in it, metres; may be infinite.
    t_s : tuple of 2 float
        Seconds since the epoch; may be infinite.
    """
    listed = [[frame, *(_kept(v) for v in box)] for frame, box in boxes]
    return {"candidate_boxes": json.dumps(listed), "candidate_t0": _kept(t_s[0]), "candidate_t1": _kept(t_s[1])}


def _side(place: int) -> str:
    return f"json_extract(b.value, '$[{place}]')"


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

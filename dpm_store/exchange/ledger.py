# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Database of an exchange: products to send, and items that were received in part.

It is a file of its own, so that a store without an exchange has neither the file nor its cost. A commit
survives the end of the process. A loss of power can undo the newest commits: the other side then sends the
same items again, and the ids of products prevent that one is stored twice.
"""

from __future__ import annotations

import json
import sqlite3
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import msgpack

from cdff_common.errors import StorageError

FILE_NAME = "exchange.sqlite"
#: Intervals of bytes, each from a first offset to a last one (exclusive), in order.
Ranges = list[tuple[int, int]]

_TABLES = """
CREATE TABLE IF NOT EXISTS notes (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS outbox (ordinal INTEGER PRIMARY KEY, priority INTEGER NOT NULL,
    product_id TEXT NOT NULL, size INTEGER NOT NULL, announced INTEGER NOT NULL DEFAULT 0);
CREATE INDEX IF NOT EXISTS outbox_product ON outbox (product_id);
CREATE TABLE IF NOT EXISTS announced (robot TEXT, ordinal INTEGER, priority INTEGER NOT NULL,
    size INTEGER NOT NULL, body BLOB NOT NULL, PRIMARY KEY (robot, ordinal)) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS parts (robot TEXT, key INTEGER, total INTEGER NOT NULL, ranges BLOB NOT NULL,
    PRIMARY KEY (robot, key)) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS requests (id TEXT PRIMARY KEY, robot TEXT NOT NULL, state TEXT NOT NULL,
    made_ns INTEGER NOT NULL, expires_ns INTEGER NOT NULL, body TEXT NOT NULL,
    result TEXT NOT NULL) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS requests_state ON requests (state, robot, made_ns, id);
CREATE TABLE IF NOT EXISTS changes (robot TEXT, ordinal INTEGER, product_id TEXT NOT NULL, kind TEXT NOT NULL,
    fields TEXT NOT NULL, PRIMARY KEY (robot, ordinal)) WITHOUT ROWID;
CREATE TABLE IF NOT EXISTS owned (product_id TEXT, field TEXT, PRIMARY KEY (product_id, field)) WITHOUT ROWID;
"""


class OutboxRow(NamedTuple):
    """A product that is not known to be stored at the other side.

    Attributes
    ----------
    ordinal : int
        Ordinal of its event ``inserted``.
    priority : int
        0 is sent first.
    product_id : str
    size : int
        Bytes of the payload.
    announced : bool
        Whether the other side has its record.
    """

    ordinal: int
    priority: int
    product_id: str
    size: int
    announced: bool = False


class AnnouncedRow(NamedTuple):
    """A product whose record was received and whose payload was not."""

    ordinal: int
    priority: int
    size: int
    body: bytes


class PartRow(NamedTuple):
    """An item of which some bytes were received."""

    key: int
    total: int
    ranges: Ranges


class RequestRow(NamedTuple):
    """A request for a robot.

    Attributes
    ----------
    state : str
        kept, accepted, executed, answered, failed or expired.
    """

    id: str
    robot: str
    state: str
    made_ns: int
    expires_ns: int
    body: dict[str, Any]
    result: dict[str, Any] | None


class ChangeRow(NamedTuple):
    """A change of a product of a robot that is not applied at the ground.

    Attributes
    ----------
    ordinal : int
        Ordinal of its event in the store of the robot.
    product_id : str
    kind : str
        ``updated`` or ``deleted``.
    values : dict
        Changed fields of the annotation.
    """

    ordinal: int
    product_id: str
    kind: str
    values: dict[str, Any]


class Ledger:
    """The database, used by several threads.

    Raises
    ------
    StorageError
        Each method, if the disk is full or fails, or the file is damaged.
    """

    def __init__(self, directory: Path) -> None:
        self._lock = threading.RLock()
        self._is_open = False
        path = directory / FILE_NAME
        try:
            self._database = sqlite3.connect(path, check_same_thread=False, isolation_level=None)
            self._database.execute("PRAGMA journal_mode=WAL")
            self._database.execute("PRAGMA synchronous=NORMAL")
            self._database.executescript(_TABLES)
        except sqlite3.Error as error:
            raise StorageError(f"{path}: {error}; remove the file, and the exchange starts again") from error

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._database.close()

    @contextmanager
    def transaction(self) -> Iterator[None]:
        """Commit the changes inside the block together; nested blocks belong to the outer one."""
        with self._lock:
            if self._is_open:
                yield
                return
            self._is_open = True
            try:
                self._database.execute("BEGIN IMMEDIATE")
                yield
                self._database.execute("COMMIT")
            except sqlite3.Error as error:
                raise StorageError(f"{FILE_NAME}: {error}") from error
            finally:
                self._is_open = False
                if self._database.in_transaction:
                    self._database.execute("ROLLBACK")

    def note(self, name: str, default: Any = None) -> Any:
        """Return a small value by its name."""
        rows = self._read("SELECT value FROM notes WHERE name = ?", (name,))
        return json.loads(rows[0][0]) if rows else default

    def set_note(self, name: str, value: Any) -> None:
        """Replace a small value."""
        self._write("INSERT OR REPLACE INTO notes VALUES (?, ?)", [(name, json.dumps(value))])

    # --- products to send

    def add_to_outbox(self, rows: Iterable[OutboxRow]) -> None:
        """Add products to send; existing rows stay as they are."""
        self._write("INSERT OR IGNORE INTO outbox VALUES (?, ?, ?, ?, ?)", rows)

    def outbox(self) -> list[OutboxRow]:
        """Return the products to send, in their order."""
        rows = self._read("SELECT * FROM outbox ORDER BY priority, ordinal")
        return [OutboxRow(*row)._replace(announced=bool(row[4])) for row in rows]

    def set_announced(self, ordinals: Iterable[int]) -> None:
        """Note that the other side has the records of products."""
        self._write("UPDATE outbox SET announced = 1 WHERE ordinal = ?", [(o,) for o in ordinals])

    def remove_from_outbox(self, ordinals: Iterable[int]) -> None:
        """Remove products that the other side has stored."""
        self._write("DELETE FROM outbox WHERE ordinal = ?", [(o,) for o in ordinals])

    def prioritise(self, product_id: str) -> int | None:
        """Send a product before others; return its ordinal, None if it is not to be sent."""
        self._write("UPDATE outbox SET priority = 0 WHERE product_id = ?", [(product_id,)])
        rows = self._read("SELECT ordinal FROM outbox WHERE product_id = ?", (product_id,))
        return rows[0][0] if rows else None

    # --- received items

    def announce(self, robot: str, rows: Iterable[AnnouncedRow]) -> None:
        """Add records whose payloads are still to come."""
        self._write("INSERT OR REPLACE INTO announced VALUES (?, ?, ?, ?, ?)", [(robot, *r) for r in rows])

    def announced(self, robot: str) -> list[AnnouncedRow]:
        """Return the records whose payloads are still to come, in the order in which they will be sent."""
        rows = self._read(
            "SELECT ordinal, priority, size, body FROM announced WHERE robot = ? ORDER BY priority, ordinal",
            (robot,),
        )
        return [AnnouncedRow(*row) for row in rows]

    def prioritise_announced(self, robot: str, ordinals: Iterable[int]) -> None:
        """Note that the payloads of records are sent before others."""
        statement = "UPDATE announced SET priority = 0 WHERE robot = ? AND ordinal = ?"
        self._write(statement, [(robot, ordinal) for ordinal in ordinals])

    def remove_announced(self, robot: str, ordinals: Iterable[int]) -> None:
        """Remove records whose products are stored."""
        self._write("DELETE FROM announced WHERE robot = ? AND ordinal = ?", [(robot, o) for o in ordinals])

    def set_parts(self, robot: str, parts: Iterable[PartRow]) -> None:
        """Note the bytes that were received of items."""
        rows = [(robot, part.key, part.total, msgpack.packb(part.ranges)) for part in parts]
        self._write("INSERT OR REPLACE INTO parts VALUES (?, ?, ?, ?)", rows)

    def parts(self, robot: str) -> list[PartRow]:
        """Return the items that were received in part."""
        rows = self._read("SELECT key, total, ranges FROM parts WHERE robot = ? ORDER BY key", (robot,))
        return [PartRow(k, t, [(a, b) for a, b in msgpack.unpackb(ranges)]) for k, t, ranges in rows]

    def remove_parts(self, robot: str, keys: Iterable[int]) -> None:
        """Remove items that are complete or void."""
        self._write("DELETE FROM parts WHERE robot = ? AND key = ?", [(robot, key) for key in keys])

    def clear(self, robot: str) -> None:
        """Remove the incomplete items and the changes of a robot whose store is another one now."""
        with self.transaction():
            for table in ("announced", "parts", "changes"):
                self._write(f"DELETE FROM {table} WHERE robot = ?", [(robot,)])

    # --- annotations and deletions

    def add_changes(self, robot: str, rows: Iterable[ChangeRow]) -> None:
        """Add changes of a robot; existing rows stay as they are."""
        values = [(robot, *row[:3], json.dumps(row.values)) for row in rows]
        self._write("INSERT OR IGNORE INTO changes VALUES (?, ?, ?, ?, ?)", values)

    def changes(self, robot: str) -> list[ChangeRow]:
        """Return the changes of a robot that are not applied, oldest first."""
        rows = self._read(
            "SELECT ordinal, product_id, kind, fields FROM changes WHERE robot = ? ORDER BY ordinal", (robot,)
        )
        return [ChangeRow(ordinal, name, kind, json.loads(text)) for ordinal, name, kind, text in rows]

    def remove_change(self, robot: str, ordinal: int) -> None:
        """Remove a change that is applied or refused."""
        self._write("DELETE FROM changes WHERE robot = ? AND ordinal = ?", [(robot, ordinal)])

    def set_owned(self, product_id: str, fields: Iterable[str]) -> None:
        """Note fields of an annotation that were changed at the ground."""
        rows = [(product_id, name) for name in fields]
        self._write("INSERT OR IGNORE INTO owned VALUES (?, ?)", rows)

    def owned(self, product_id: str) -> set[str]:
        """Return the fields of an annotation that were changed at the ground."""
        return {row[0] for row in self._read("SELECT field FROM owned WHERE product_id = ?", (product_id,))}

    # --- requests

    def add_request(self, row: RequestRow) -> bool:
        """Add a request; return False if its id is known."""
        values = (*row[:5], json.dumps(row.body), json.dumps(row.result))
        return self._write("INSERT OR IGNORE INTO requests VALUES (?, ?, ?, ?, ?, ?, ?)", [values]) > 0

    def set_request(self, request_id: str, state: str, result: dict[str, Any] | None = None) -> None:
        """Set the state of a request, and its result."""
        values = (state, json.dumps(result), request_id)
        self._write("UPDATE requests SET state = ?, result = ? WHERE id = ?", [values])

    def request(self, request_id: str) -> RequestRow | None:
        """Return a request; None for an unknown id."""
        return next(map(_request, self._read("SELECT * FROM requests WHERE id = ?", (request_id,))), None)

    def requests(
        self, *states: str, robot: str | None = None, expired_ns: int | None = None, limit: int = -1
    ) -> list[RequestRow]:
        """Return the requests in some states, or all, the oldest first.

        Parameters
        ----------
        robot : str, optional
            Only those for a robot.
        expired_ns : int, optional
            Only those that have expired at this time.
        limit : int
            Largest number of them; -1 for all.
        """
        conditions, values = ["TRUE"], list[object]()
        if states:
            conditions.append(f"state IN ({', '.join('?' * len(states))})")
            values += states
        for condition, value in (("robot = ?", robot), ("expires_ns <= ?", expired_ns)):
            if value is not None:
                conditions.append(condition)
                values.append(value)
        statement = f"SELECT * FROM requests WHERE {' AND '.join(conditions)} ORDER BY made_ns, id LIMIT ?"
        return [_request(row) for row in self._read(statement, (*values, limit))]

    def remove_ended_requests(self, before_ns: int, changes_before_ns: int, states: Sequence[str]) -> None:
        """Remove the requests in other states than ``states`` that were made before a time.

        Changes of annotations and deletions have a time of their own.
        """
        marks = ", ".join("?" * len(states))
        self._write(
            f"DELETE FROM requests WHERE state NOT IN ({marks}) AND made_ns < "
            "CASE WHEN json_extract(body, '$.change') IS NULL THEN ? ELSE ? END",
            [(*states, before_ns, changes_before_ns)],
        )

    def _read(self, statement: str, values: Sequence[object] = ()) -> list[Any]:
        with self._lock:
            try:
                return self._database.execute(statement, values).fetchall()
            except sqlite3.Error as error:
                raise StorageError(f"{FILE_NAME}: {error}") from error

    def _write(self, statement: str, rows: Iterable[Sequence[object]]) -> int:
        with self.transaction():
            return self._database.executemany(statement, rows).rowcount


def _request(row: Sequence[Any]) -> RequestRow:
    return RequestRow(*row)._replace(body=json.loads(row[5]), result=json.loads(row[6]))

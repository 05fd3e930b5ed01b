# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transactions: readers see a snapshot, writers queue, and errors of the engine become StorageError."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from sqlalchemy import Connection, Table
from sqlalchemy.exc import DatabaseError

from cdff_common.errors import ConfigurationError, StorageError
from dpm_store.engine import sqlite
from dpm_store.engine.dialect import WRITES, Dialect
from dpm_store.engine.disk_space import DiskSpace

logger = logging.getLogger(__name__)


class _Dialects(dict[str, Dialect]):
    """Engines by SQLAlchemy's name; that of a server is imported when it is used."""

    def __missing__(self, name: str) -> Dialect:
        try:
            from dpm_store.engine import postgresql
        except ImportError as error:
            raise ConfigurationError(f"store: {error}; install the extra `cdff[scale]`") from error
        self[name] = postgresql
        return postgresql


#: Engine of stores in a directory.
EMBEDDED = sqlite
DIALECTS: dict[str, Dialect] = _Dialects(sqlite=sqlite)


def dialect_of(connection: Connection) -> Dialect:
    """Return the engine of a connection."""
    return DIALECTS[connection.dialect.name]


def add_to_tallies(
    connection: Connection, table: Table, sizes: Iterable[tuple[tuple[Any, ...], int]]
) -> None:
    """Add rows, given as key and bytes, to the sums of rows and bytes in ``table``.

    It is faster than a trigger per row.
    """
    sums: dict[tuple[Any, ...], tuple[int, int]] = {}
    for key, size in sizes:
        count, total = sums.get(key, (0, 0))
        sums[key] = count + 1, total + size
    names = [column.name for column in table.primary_key]
    rows = [
        {**dict(zip(names, key, strict=True)), "live": count, "bytes": total}
        for key, (count, total) in sums.items()
    ]
    dialect_of(connection).upsert_rows(connection, table, rows, add=("live", "bytes"))


class WriteObserver(Protocol):
    """Observer of committed transactions."""

    def unrecorded(self, connection: Connection) -> Any:
        """Return the changes of a transaction, just before its commit."""

    def record(self, changes: Any) -> None:
        """Process these changes after the commit, while no other transaction writes."""


class Database:
    """The database of a store, in its directory or at a URL, with its kinds of transaction.

    Attributes
    ----------
    dialect : Dialect
    disk_space : DiskSpace
        Limits of additions.
    write_lock : RLock
        Lock of the thread that writes.
    observer : WriteObserver or None
    """

    def __init__(
        self,
        directory: Path,
        disk_space: DiskSpace | None = None,
        dialect: Dialect = EMBEDDED,
        url: str = "",
    ) -> None:
        self.dialect = dialect
        self.disk_space = disk_space or DiskSpace(directory)
        self.engine = dialect.open_engine(url or directory / dialect.FILE_NAME)
        self.write_lock = threading.RLock()
        self.observer: WriteObserver | None = None

    @contextmanager
    def read(self, connection: Connection | None = None) -> Iterator[Connection]:
        """Run a transaction that sees one state of the store and never waits for a writer.

        A given connection is used in its open transaction; this holds for the other methods too.
        """
        if connection is not None:
            yield connection
            return
        with self._translated_errors(), self.engine.begin() as transaction:
            yield transaction

    @contextmanager
    def write(self, connection: Connection | None = None) -> Iterator[Connection]:
        """Run an exclusive transaction; durable when the block ends without an error.

        Raises
        ------
        StorageError
            If the disk is nearly full, full, or fails: the transaction has no effect.
        """
        if connection is not None:
            yield connection
            return
        self.admit(0)
        with self.write_lock, self.session() as session, session.write() as transaction:
            yield transaction

    @contextmanager
    def deletion(self, connection: Connection | None = None) -> Iterator[Connection]:
        """Run a write transaction that frees space, also on a full disk; the log is shortened afterwards."""
        if connection is not None:
            yield connection
            return
        with self.write_lock, self.session() as session, session.deletion() as transaction:
            yield transaction

    @contextmanager
    def session(self) -> Iterator[Session]:
        """Open one connection for several transactions, so that temporary tables persist between them."""
        with self._translated_errors(), self.engine.connect() as connection:
            yield Session(self, connection)

    def admit(self, payload_bytes: int) -> None:
        """Raise StorageError if payloads of this size would leave too little space to delete."""
        if not self.disk_space.holds(payload_bytes):
            with self.write_lock:
                self.dialect.checkpoint(self.engine)
        self.disk_space.admit(payload_bytes)

    def close(self) -> None:
        """Close every connection; the last one copies the write-ahead log into the file."""
        self.engine.dispose()

    @contextmanager
    def _translated_errors(self) -> Iterator[None]:
        """Raise errors of the database as StorageError."""
        try:
            yield
        except DatabaseError as error:
            raise StorageError(f"store: {error.orig}") from error
        except self.dialect.Error as error:
            raise StorageError(f"store: {error}") from error


class Session:
    """One connection and its transactions."""

    def __init__(self, database: Database, connection: Connection) -> None:
        self._database = database
        self._connection = connection

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """Run a transaction like ``Database.read``."""
        with self._transaction(writes=False) as connection:
            yield connection

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """Run a transaction like ``Database.write``, without its check of the disk space."""
        observer = self._database.observer
        with self._database.write_lock:
            with self._transaction(writes=True) as connection:
                yield connection
                changes = None if observer is None else observer.unrecorded(connection)
            if observer is not None:
                observer.record(changes)

    @contextmanager
    def deletion(self) -> Iterator[Connection]:
        """Run a transaction like ``Database.deletion``."""
        database = self._database
        with database.disk_space.deletion():
            with self.write() as connection:
                yield connection
            if database.disk_space.is_low():
                try:
                    database.dialect.checkpoint(database.engine)
                except StorageError as error:  # the deletion itself is committed
                    logger.warning("log not shortened", extra={"why": str(error)})

    @contextmanager
    def _transaction(self, *, writes: bool) -> Iterator[Connection]:
        connection = self._connection.execution_options(**{WRITES: writes})
        with connection.begin():
            yield connection

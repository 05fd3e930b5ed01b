# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transactions: readers see a snapshot, writers queue, and the engine's errors become ours."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import unquote

from sqlalchemy import Connection
from sqlalchemy.exc import DatabaseError

from cdff_common.errors import ConfigurationError, StorageError
from dpm_store import sqlite
from dpm_store.room import Room

logger = logging.getLogger(__name__)


def directory_of(url: str) -> Path:
    """Directory of a ``sqlite:///dir`` URL (a fourth slash makes it absolute).

    Raises
    ------
    ConfigurationError
        If the URL names another engine: none but SQLite is built yet.
    """
    scheme, separator, rest = url.partition(":///")
    if scheme != "sqlite" or not separator or not rest:
        raise ConfigurationError(f"store {url!r}: expected sqlite:///directory")
    return Path(unquote(rest))


class Database:
    """The engine with its kinds of transaction.

    Attributes
    ----------
    room : Room
        What may still be added.
    writing : RLock
        Held by whoever writes.
    """

    def __init__(self, path: Path, room: Room | None = None) -> None:
        self.dialect = sqlite
        self.room = Room(path.parent) if room is None else room
        self.engine = sqlite.open_engine(path)
        self.writing = threading.RLock()

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """A transaction that sees one state of the store and never waits for a writer."""
        with _translated(), self.engine.begin() as connection:
            yield connection

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """A transaction that has the store for itself; durable when the block is left without an error.

        Raises
        ------
        StorageError
            If the disk is nearly full, full, or fails: nothing of the transaction is kept.
        """
        self.admit(0)
        with self.writing, self.session() as session, session.write() as connection:
            yield connection

    @contextmanager
    def freeing(self) -> Iterator[Connection]:
        """As ``write``, for what makes room: allowed on a full disk too; the log is folded into the file afterwards."""
        with self.writing, self.session() as session, session.freeing() as connection:
            yield connection

    @contextmanager
    def session(self) -> Iterator[Session]:
        """One connection for several transactions, so that temporary tables last over them."""
        with _translated(), self.engine.connect() as plain:
            yield Session(self, plain)

    def admit(self, wanted_bytes: int) -> None:
        """Raise StorageError where so many bytes of payload would leave too little room to delete."""
        if not self.room.holds(wanted_bytes):
            with self.writing:
                sqlite.fold_log(self.engine)
        self.room.admit(wanted_bytes)

    def close(self) -> None:
        """Close every connection; the last one folds the write-ahead log into the file."""
        self.engine.dispose()


class Session:
    """One connection and its transactions."""

    def __init__(self, database: Database, connection: Connection) -> None:
        self._database = database
        self._connection = connection

    @contextmanager
    def read(self) -> Iterator[Connection]:
        """As ``Database.read``."""
        with self._begun(writes=False) as connection:
            yield connection

    @contextmanager
    def write(self) -> Iterator[Connection]:
        """As ``Database.write``, without its question whether there is room."""
        with self._database.writing, self._begun(writes=True) as connection:
            yield connection

    @contextmanager
    def freeing(self) -> Iterator[Connection]:
        """As ``Database.freeing``."""
        room = self._database.room
        with room.freeing():
            with self.write() as connection:
                yield connection
            if room.is_low():
                try:
                    sqlite.fold_log(self._database.engine)
                except StorageError as error:  # what was asked for is done
                    logger.warning("log not folded", extra={"why": str(error)})

    @contextmanager
    def _begun(self, *, writes: bool) -> Iterator[Connection]:
        connection = self._connection.execution_options(**{sqlite.WRITES: writes})
        with connection.begin():
            yield connection


@contextmanager
def _translated() -> Iterator[None]:
    try:
        yield
    except DatabaseError as error:
        raise StorageError(f"store: {error.orig}") from error
    except sqlite.Error as error:
        raise StorageError(f"store: {error}") from error

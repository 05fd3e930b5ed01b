# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transactions: readers see a snapshot, writers queue, and the engine's errors become ours."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import unquote

from sqlalchemy import Connection
from sqlalchemy.exc import DatabaseError

from cdff_common.errors import ConfigurationError, StorageError
from dpm_store import sqlite


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
    """The engine with its two kinds of transaction."""

    def __init__(self, path: Path) -> None:
        self.dialect = sqlite
        self.engine = sqlite.open_engine(path)
        self._writing = threading.RLock()

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
            If the disk is full or fails: nothing of the transaction is kept.
        """
        with _translated(), self._writing, self.engine.connect() as plain:
            connection = plain.execution_options(**{sqlite.WRITES: True})
            with connection.begin():
                yield connection

    def close(self) -> None:
        """Close every connection; the last one folds the write-ahead log into the file."""
        self.engine.dispose()


@contextmanager
def _translated() -> Iterator[None]:
    try:
        yield
    except DatabaseError as error:
        raise StorageError(f"store: {error.orig}") from error

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The interface of a database engine: opening, bulk statements, the spatial index and maintenance.

Every other statement is SQLAlchemy Core and the same for all engines. A module that implements ``Dialect`` is
registered in ``database.DIALECTS``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, Protocol

from sqlalchemy import ColumnElement, Connection, Engine, Select, Subquery, Table
from sqlalchemy.sql.dml import Insert

from dpm_store.engine.commit_watch import CommitWatch

#: Execution option of a connection for a transaction that writes.
WRITES = "cdff_writes"

#: A box of the spatial index: ordinal of the bucket (frame and type), then ``xmin ymin zmin xmax ymax zmax``
#: in metres in the frame.
IndexBox = tuple[int, Sequence[float]]
#: An entry of the spatial index: ordinal of the product, box, start and end of capture in seconds since the
#: epoch of the store.
IndexEntry = tuple[int, IndexBox, tuple[float, float]]


class Dialect(Protocol):
    """The operations that differ between database engines."""

    @property
    def FILE_NAME(self) -> str:
        """Name of the database file in the directory of a store; empty for a database on a server."""

    @property
    def is_shared(self) -> bool:
        """True if several processes open one store."""

    @property
    def Error(self) -> type[Exception]:
        """Base class of the exceptions of the driver."""

    @property
    def INDEXES(self) -> tuple[str, str]:
        """Spatial index of the live products, then of the deleted ones."""

    def open_engine(self, location: Path | str) -> Engine:
        """Open or create the database in a file, or connect to that of a URL; every commit is durable."""

    def watch(self, engine: Engine, *, takes_lease: bool) -> CommitWatch:
        """Follow the commits of all processes; see ``CommitWatch``."""

    def checkpoint(self, engine: Engine) -> None:
        """Shorten the write-ahead log as far as readers allow; raises StorageError if the disk fails."""

    def check(self, connection: Connection) -> list[str]:
        """Return the defects of the database file and of the spatial index; empty when there are none."""

    def fetch(
        self, connection: Connection, statement: Select[Any], values: Mapping[str, Any] | None = None
    ) -> list[Any]:
        """Run a statement that is executed often, on the driver: SQLAlchemy takes longer than the statement.

        The statement is compiled once, so it must be a constant; ``values`` are those of its parameters.
        """

    def fetch_ahead(self, connection: Connection, statements: Sequence[Select[Any]]) -> None:
        """Run constant statements without parameters in one round trip, if the server is another process.

        In this transaction the next ``fetch`` of each of them returns the rows that were read.
        """

    def fetch_together(
        self, connection: Connection, calls: Sequence[tuple[Select[Any], Mapping[str, Any]]]
    ) -> list[list[Any]]:
        """Return the rows of several statements with their values; see ``fetch``. One round trip."""

    def elements(self, name: str, of: type = str) -> Select[Any]:
        """Return a select of the elements, of one type, of a list parameter with a ``list_value``."""

    def elements_of(self, values: Sequence[Any]) -> Select[Any]:
        """Return a select of several values that are bound as one parameter."""

    def matches(self, value: ColumnElement[Any], pattern: str) -> ColumnElement[bool]:
        """Return whether a text matches a pattern of ``LIKE``, in which a backslash escapes; case matters."""

    def interruptible(
        self, connection: Connection, is_over: Callable[[], bool]
    ) -> AbstractContextManager[None]:
        """Interrupt the statements of the block once ``is_over()`` is true; raises OverloadedError then."""

    def list_value(self, elements: Sequence[Any]) -> Any:
        """Return the value of a list parameter."""

    def listed_products(self, columns: Sequence[str]) -> Subquery:
        """Return columns of the products whose ordinals are bound to the list parameter ``ordinals``."""

    def insert_or_ignore(self, table: Table) -> Insert:
        """Return an insertion that skips rows whose key exists."""

    def insert_rows(self, connection: Connection, table: Table, rows: Sequence[Mapping[str, Any]]) -> None:
        """Insert rows that have the same columns in the same order."""

    def upsert_rows(
        self,
        connection: Connection,
        table: Table,
        rows: Sequence[Mapping[str, Any]],
        *,
        add: Sequence[str] = (),
        replace: Sequence[str] = (),
    ) -> None:
        """Insert rows; for an existing key, add to columns and replace others by values other than None.

        Without columns, existing rows stay as they are.
        """

    def index_products(self, connection: Connection, entries: Iterable[IndexEntry]) -> None:
        """Enter products in the spatial index."""

    def index_deleted(self, connection: Connection, ordinal: int) -> None:
        """Move a product to the index of deleted products."""

    def candidates(self, index: str) -> Select[Any]:
        """Return a select of the ordinals in an index whose box may overlap one of ``candidate_values``."""

    def candidate_values(self, boxes: Sequence[IndexBox], t_s: tuple[float, float]) -> dict[str, Any]:
        """Return the parameters of ``candidates``; times in seconds since the epoch, may be infinite."""

    def candidates_between(
        self,
        connection: Connection,
        index: str,
        boxes: Sequence[IndexBox],
        ends_s: tuple[float, float],
        started_before_s: float | None,
        limit: int | None = None,
    ) -> list[tuple[int, float]]:
        """Return ordinals and end keys (see ``end_bounds_s``) of products whose box may overlap one of these.

        Parameters
        ----------
        ends_s : tuple of 2 float
            Interval of the end of capture, seconds since the epoch; products slightly outside may be
            included.
        started_before_s : float or None
            Upper bound of the start of capture.
        limit : int, optional
            At most one more than this is returned for each box.
        """

    def end_bounds_s(self, end_key: float) -> tuple[float, float]:
        """Return the earliest and latest end of capture of an end key, seconds since the epoch."""

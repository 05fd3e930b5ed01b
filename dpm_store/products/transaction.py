# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Several changes of products and frames in one transaction, all or none."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import Connection

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from dpm_store.engine.database import Database
from dpm_store.frames.frames import FrameRevision, FrameTable
from dpm_store.history.events import EventTable
from dpm_store.products.annotations import Annotation, AnnotationTable
from dpm_store.products.insertion import PreparedProduct
from dpm_store.products.products import MAX_BATCH, ProductTable
from dpm_store.products.records import Insertion, NewProduct


@dataclass(frozen=True, slots=True)
class Update:
    """A change of the annotations of a product; see ``AnnotationTable.update``."""

    product_id: str
    changes: Mapping[str, Any]
    if_match: int | None = None
    author: str = ""


@dataclass(frozen=True, slots=True)
class Delete:
    """A deletion; with ``if_match`` only if the annotations are at that revision."""

    product_id: str
    if_match: int | None = None


@dataclass(frozen=True, slots=True)
class Reanchor:
    """A new revision of a frame; see ``FrameTable.set``."""

    frame: str
    parent: str
    T_parent_frame: UncertainTransform
    options: Mapping[str, Any] = field(default_factory=dict)


Change = NewProduct | Update | Delete | Reanchor
#: Outcome of an insertion; new annotations; whether a product was deleted now; or a new frame revision.
Outcome = Insertion | Annotation | bool | FrameRevision


class Transactions:
    """Execution of lists of changes."""

    def __init__(
        self,
        database: Database,
        products: ProductTable,
        annotations: AnnotationTable,
        frames: FrameTable,
        events: EventTable,
    ) -> None:
        self._events = events
        self._database = database
        self._products = products
        self._annotations = annotations
        self._frames = frames

    def run(
        self, changes: Sequence[Change], entry: tuple[str, str, Mapping[str, Any]] | None = None
    ) -> tuple[Outcome, ...]:
        """Make every change, in order; durable when this returns.

        Later changes see the effects of earlier ones. ``entry`` is the scope, kind and body of an entry of
        the history about all of them.

        Raises
        ------
        InputError
            If there is no change or more than ``MAX_BATCH``. An error of any change undoes all changes.
        """
        if not 1 <= len(changes) <= MAX_BATCH:
            raise InputError(f"transaction of {len(changes)} changes: expected 1 to {MAX_BATCH}")
        prepared = iter(self._products.prepare([c for c in changes if isinstance(c, NewProduct)]))
        only_deletes = all(isinstance(change, Delete) for change in changes)
        with self._database.deletion() if only_deletes else self._database.write() as connection:
            outcomes = tuple(self._make(connection, change, prepared) for change in changes)
            if entry is not None:
                self._events.append(*entry, connection=connection)
            return outcomes

    def _make(self, connection: Connection, change: Change, prepared: Iterator[PreparedProduct]) -> Outcome:
        """Execute one change of a transaction and return its outcome."""
        if isinstance(change, NewProduct):
            return self._products.inserter.insert_in(connection, [next(prepared)])[0]
        if isinstance(change, Update):
            return self._annotations.update(
                change.product_id,
                change.changes,
                if_match=change.if_match,
                author=change.author,
                connection=connection,
            )
        if isinstance(change, Delete):
            if change.if_match is not None:
                self._annotations.check_in(connection, change.product_id, change.if_match)
            return self._products.delete(change.product_id, connection=connection)
        return self._frames.set(
            change.frame, change.parent, change.T_parent_frame, **dict(change.options), connection=connection
        )

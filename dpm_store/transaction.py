# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Several changes of several products and frames in one transaction: all of them, in their order, or none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy import Connection

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from dpm_store.annotations import Annotation, AnnotationTable
from dpm_store.database import Database
from dpm_store.frames import FrameRevision, FrameTable
from dpm_store.insertion import Ready
from dpm_store.products import MAX_BATCH, ProductTable
from dpm_store.records import Insertion, Parcel


@dataclass(frozen=True, slots=True)
class Insert:
    """A product comes."""

    parcel: Parcel


@dataclass(frozen=True, slots=True)
class Update:
    """What is said of a product changes: tags, notes, a pin, a judgement, its successor; see ``AnnotationTable``."""

    product_id: str
    changes: Mapping[str, Any]
    if_match: int | None = None
    author: str = ""


@dataclass(frozen=True, slots=True)
class Delete:
    """A product goes; only if it is at revision ``if_match``, where that is given."""

    product_id: str
    if_match: int | None = None


@dataclass(frozen=True, slots=True)
class Reanchor:
    """A frame gets a new revision; see ``FrameTable.set``."""

    frame: str
    parent: str
    T_parent_frame: UncertainTransform
    options: Mapping[str, Any] = field(default_factory=dict)


Change = Insert | Update | Delete | Reanchor
#: Of each change: inserted or already; the new revision; whether it was deleted now; the new frame revision.
Outcome = Insertion | Annotation | bool | FrameRevision


class Transactions:
    """Runs lists of changes."""

    def __init__(
        self, database: Database, products: ProductTable, annotations: AnnotationTable, frames: FrameTable
    ) -> None:
        self._database = database
        self._products = products
        self._annotations = annotations
        self._frames = frames

    def run(self, changes: Sequence[Change]) -> tuple[Outcome, ...]:
        """Make every change, in order; durable when this returns.

        Later changes see what earlier ones did: a product can be inserted and stand in the place of another at once.

        Raises
        ------
        InputError
            On none or more than ``MAX_BATCH`` changes, and whatever a change by itself raises: nothing is changed then.
        """
        if not 1 <= len(changes) <= MAX_BATCH:
            raise InputError(f"transaction of {len(changes)} changes: expected 1 to {MAX_BATCH}")
        ready = iter(self._products.prepare([c.parcel for c in changes if isinstance(c, Insert)]))
        frees = all(isinstance(change, Delete) for change in changes)
        with self._database.freeing() if frees else self._database.write() as connection:
            return tuple(self._make(connection, change, ready) for change in changes)

    def _make(self, connection: Connection, change: Change, ready: Any) -> Outcome:
        if isinstance(change, Insert):
            prepared: Ready = next(ready)
            return self._products.insert_in(connection, [prepared])[0]
        if isinstance(change, Update):
            return self._annotations.update_in(
                connection, change.product_id, change.changes, if_match=change.if_match, author=change.author
            )
        if isinstance(change, Delete):
            if change.if_match is not None:
                self._annotations.check_in(connection, change.product_id, change.if_match)
            return self._products.delete_in(connection, change.product_id)
        return self._frames.set_in(
            connection, change.frame, change.parent, change.T_parent_frame, **dict(change.options)
        )

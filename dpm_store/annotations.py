# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What is said of a product after it was made: tags, notes, a pin, a judgement of its quality, its successor.

The product itself never changes. Each change is a new revision that names the one it was made from, so that of two
who change the same at once the second is told (optimistic concurrency), and all revisions stay.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import msgpack
from sqlalchemy import ColumnElement, Connection, Row, func, insert, select

from cdff_common.clock import Clock
from cdff_common.errors import ConflictError, InputError, ProductNotFoundError
from cdff_common.interfaces.product import Quality
from dpm_store import schema
from dpm_store.database import Database
from dpm_store.events import EventTable

#: What an update may change.
FIELDS = ("tags", "notes", "pinned", "quality", "superseded_by")
MAX_TAGS = 64
MAX_NOTES = 16_384
TAG = re.compile(r"[a-z0-9][a-z0-9_.:\-]{0,63}\Z")


class StaleRevisionError(ConflictError):
    """Somebody else changed it since it was read: read again, then change."""


@dataclass(frozen=True, slots=True)
class Annotation:
    """One revision.

    Attributes
    ----------
    revision : int
        0 where nothing was said yet.
    tags : tuple of str
        Sorted, each once.
    notes : str
    pinned : bool
        A pinned product is neither deleted nor retired.
    quality : Quality or None
        Somebody's judgement; beside what the header says, not in its place.
    superseded_by : str or None
        Id of the product that stands in its place.
    author : str
        Who said so.
    stamp_ns : int
        Mission time of the revision.
    """

    product_id: str
    revision: int = 0
    tags: tuple[str, ...] = ()
    notes: str = ""
    pinned: bool = False
    quality: Quality | None = None
    superseded_by: str | None = None
    author: str = ""
    stamp_ns: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Plain data for MessagePack and JSON."""
        return {
            "revision": self.revision, "tags": list(self.tags), "notes": self.notes, "pinned": self.pinned,
            "quality": None if self.quality is None else self.quality.to_dict(),
            "superseded_by": self.superseded_by, "author": self.author, "stamp_ns": self.stamp_ns,
        }  # fmt: skip


class AnnotationTable:
    """Annotations of products, append-only."""

    def __init__(self, database: Database, events: EventTable, clock: Clock) -> None:
        self._database = database
        self._events = events
        self._clock = clock

    def get(self, product_id: str, as_of_ns: int | None = None) -> Annotation:
        """The last revision, as known at ``as_of_ns``; revision 0 where nothing was said."""
        with self._database.read() as connection:
            return self.get_in(connection, product_id, as_of_ns)

    @staticmethod
    def get_in(connection: Connection, product_id: str, as_of_ns: int | None = None) -> Annotation:
        """As ``get``, inside a transaction."""
        a = schema.annotation_revisions.c
        statement = select(schema.annotation_revisions).where(a.product_id == product_id)
        if as_of_ns is not None:
            statement = statement.where(a.stamp_ns <= as_of_ns)
        row = connection.execute(statement.order_by(a.revision.desc()).limit(1)).first()
        return Annotation(product_id) if row is None else _annotation(row)

    def history(self, product_id: str) -> tuple[Annotation, ...]:
        """All revisions, oldest first; empty where nothing was said."""
        a = schema.annotation_revisions.c
        with self._database.read() as connection:
            rows = connection.execute(
                select(schema.annotation_revisions).where(a.product_id == product_id).order_by(a.revision)
            ).all()
        return tuple(_annotation(row) for row in rows)

    def update(
        self, product_id: str, changes: Mapping[str, Any], *, if_match: int | None, author: str = ""
    ) -> Annotation:
        """Add a revision; what ``changes`` does not name stays as it was.

        Parameters
        ----------
        changes : mapping
            Of ``FIELDS``; ``quality`` as plain data.
        if_match : int or None
            Revision that the change was made from; None changes whatever is there.

        Returns
        -------
        Annotation
            The new revision, or the present one where nothing differs.

        Raises
        ------
        InputError
            On an unknown field or a value that it cannot hold.
        ProductNotFoundError
            For an unknown or deleted product, or a successor that is.
        StaleRevisionError
            If another revision was made since ``if_match``.
        ConflictError
            If the product would be, by a chain of successors, its own.
        """
        with self._database.write() as connection:
            return self.update_in(connection, product_id, changes, if_match=if_match, author=author)

    def update_in(
        self, connection: Connection, product_id: str, changes: Mapping[str, Any], *, if_match: int | None,
        author: str = "",
    ) -> Annotation:  # fmt: skip
        """As ``update``, inside a transaction."""
        wanted = _checked(changes)
        names = _live(connection, product_id)
        present = self.check_in(connection, product_id, if_match)
        new = replace(present, **wanted)
        if new == present:
            return present
        stamp_ns = max(self._clock.now_ns(), present.stamp_ns)
        new = replace(new, revision=present.revision + 1, author=author[:256], stamp_ns=stamp_ns)
        if new.superseded_by not in (None, present.superseded_by):
            _check_successor(connection, product_id, str(new.superseded_by))
        _enter(connection, new)
        changed = [name for name in FIELDS if getattr(new, name) != getattr(present, name)]
        body = {"id": product_id, **names, "revision": new.revision, "changed": changed, "author": new.author}
        self._events.append_in(connection, names["robot"], "updated", body, stamp_ns)
        return new

    def check_in(self, connection: Connection, product_id: str, if_match: int | None) -> Annotation:
        """The present revision; raises StaleRevisionError if it is another than ``if_match``."""
        present = self.get_in(connection, product_id)
        if if_match is not None and if_match != present.revision:
            raise StaleRevisionError(
                f"product {product_id} is at revision {present.revision}, the change was made from {if_match}: "
                "read it again"
            )
        return present

    def forget_in(self, connection: Connection, product_id: str) -> None:
        """Take a deleted product's tags and successor out of what searches use; its revisions stay."""
        for table in (schema.product_tags, schema.pins, schema.supersessions):
            connection.execute(table.delete().where(table.c.product_id == product_id))


def is_pinned(connection: Connection, product_id: str) -> bool:
    """Tell whether a product is pinned."""
    p = schema.pins.c.product_id
    return connection.execute(select(p).where(p == product_id)).first() is not None


def carries(product_id: ColumnElement[str], tag: str, as_of_ns: int | None = None) -> ColumnElement[bool]:
    """Condition that a product has a tag, or had it at ``as_of_ns``."""
    if as_of_ns is None:
        t = schema.product_tags.c
        return product_id.in_(select(t.product_id).where(t.tag == tag))
    # a tag has neither quotes nor backslashes, so that in the JSON list it is found as it is written
    return _held_at(product_id, as_of_ns, schema.annotation_revisions.c.tags.contains(f'"{tag}"', autoescape=True))


def has_successor(product_id: ColumnElement[str], as_of_ns: int | None = None) -> ColumnElement[bool]:
    """Condition that a product is superseded, or was at ``as_of_ns``."""
    if as_of_ns is None:
        return product_id.in_(select(schema.supersessions.c.product_id))
    return _held_at(product_id, as_of_ns, schema.annotation_revisions.c.superseded_by.is_not(None))


def _held_at(product_id: ColumnElement[str], as_of_ns: int, condition: ColumnElement[bool]) -> ColumnElement[bool]:
    """Condition on the last revision that was known at a time."""
    a, later = schema.annotation_revisions.c, schema.annotation_revisions.alias()
    last = select(func.max(later.c.revision)).where(later.c.product_id == a.product_id, later.c.stamp_ns <= as_of_ns)
    of_product = select(a.product_id).where(a.revision == last.scalar_subquery(), condition)
    return product_id.in_(of_product)


def _enter(connection: Connection, new: Annotation) -> None:
    row = {
        "product_id": new.product_id, "revision": new.revision, "stamp_ns": new.stamp_ns, "author": new.author,
        "tags": json.dumps(list(new.tags)), "notes": new.notes, "pinned": new.pinned,
        "quality": None if new.quality is None else msgpack.packb(new.quality.to_dict()),
        "superseded_by": new.superseded_by,
    }  # fmt: skip
    connection.execute(insert(schema.annotation_revisions), row)
    for table in (schema.product_tags, schema.pins, schema.supersessions):
        connection.execute(table.delete().where(table.c.product_id == new.product_id))
    if new.tags:
        connection.execute(insert(schema.product_tags), [{"tag": t, "product_id": new.product_id} for t in new.tags])
    if new.pinned:
        connection.execute(insert(schema.pins), {"product_id": new.product_id})
    if new.superseded_by is not None:
        connection.execute(insert(schema.supersessions), {"product_id": new.product_id, "by_id": new.superseded_by})


def _live(connection: Connection, product_id: str) -> dict[str, str]:
    p = schema.products.c
    names = select(p.robot, p.dfpc, p.port, p.product).where(p.id == product_id, p.deleted_ns.is_(None))
    row = connection.execute(names).first()
    if row is None:
        raise ProductNotFoundError(f"no product {product_id[:64]!r}")
    return {name: str(value) for name, value in row._mapping.items()}


def _check_successor(connection: Connection, product_id: str, by_id: str) -> None:
    """Refuse a successor that is not there, or that this product succeeds itself."""
    _live(connection, by_id)
    s = schema.supersessions.c
    step: str | None = by_id
    while step is not None:
        if step == product_id:
            raise ConflictError(f"product {product_id} cannot be superseded by {by_id}: it stands in its own place")
        step = connection.execute(select(s.by_id).where(s.product_id == step)).scalar()


def _checked(changes: Mapping[str, Any]) -> dict[str, Any]:
    unknown = sorted(set(map(str, changes)) - set(FIELDS))
    if unknown or not changes:
        found = f"unknown field {unknown[0][:80]!r}" if unknown else "no field"
        raise InputError(f"update: {found}, expected some of {', '.join(FIELDS)}")
    wanted = dict(changes)
    if "tags" in wanted:
        tags = wanted["tags"]
        if not isinstance(tags, (list, tuple)) or len(tags) > MAX_TAGS:
            raise InputError(f"tags: expected a list of at most {MAX_TAGS}")
        for tag in tags:
            if not isinstance(tag, str) or not TAG.match(tag):
                raise InputError(f"tag {str(tag)[:80]!r}: expected lower case letters, digits and _.:-, at most 64")
        wanted["tags"] = tuple(sorted(set(tags)))
    if "notes" in wanted and (not isinstance(wanted["notes"], str) or len(wanted["notes"]) > MAX_NOTES):
        raise InputError(f"notes: expected text of at most {MAX_NOTES} characters")
    if "pinned" in wanted and not isinstance(wanted["pinned"], bool):
        raise InputError(f"pinned={str(wanted['pinned'])[:80]!r}: expected true or false")
    if wanted.get("quality") is not None:
        if not isinstance(wanted["quality"], Mapping):
            raise InputError("quality: expected a map with a status, or none")
        wanted["quality"] = Quality.from_dict(wanted["quality"])
    if "superseded_by" in wanted and not isinstance(wanted["superseded_by"], (str, type(None))):
        raise InputError("superseded_by: expected the id of a product, or none")
    return wanted


def _annotation(row: Row[Any]) -> Annotation:
    return Annotation(
        row.product_id, row.revision, tuple(json.loads(row.tags)), row.notes, bool(row.pinned),
        None if row.quality is None else Quality.from_dict(msgpack.unpackb(row.quality)), row.superseded_by,
        row.author, row.stamp_ns,
    )  # fmt: skip

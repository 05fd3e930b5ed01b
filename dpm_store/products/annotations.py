# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Annotations of products: tags, notes, a pin, an assessment of the quality, and a successor.

The product itself never changes. Each change is a new revision that refers to its predecessor, so that of two
concurrent changes the second is refused (optimistic concurrency), and all revisions are kept.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any

import msgpack
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field
from sqlalchemy import ColumnElement, Connection, func, insert, select

from cdff_common.clock import Clock
from cdff_common.contract.parameters import Parameters
from cdff_common.errors import ConflictError, InputError, ProductNotFoundError
from cdff_common.interfaces.product import Quality
from dpm_store.engine import schema
from dpm_store.engine.database import Database
from dpm_store.history.events import EventTable
from dpm_store.products.records import NAMES

_TAG = re.compile(r"[a-z0-9][a-z0-9_.:\-]{0,63}\Z")


def _tag(text: str) -> str:
    if not _TAG.match(text):
        raise InputError(f"tag {text[:80]!r}: expected lower case letters, digits and _.:-, at most 64")
    return text


def _as_list(value: Any) -> Any:
    """Accept the tags of an ``Annotation``, which are a tuple."""
    return list(value) if isinstance(value, tuple) else value


class QualityAssessment(BaseModel):
    """Quality of a product as assessed afterwards."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    status: Annotated[str, Field(max_length=16, description="OK, DEGRADED or FAILED")]
    reasons: Annotated[list[Annotated[str, Field(max_length=200)]], Field(max_length=32)] = []
    covariance_kind: Annotated[str, Field(max_length=16)] = "none"
    metrics: Annotated[dict[Annotated[str, Field(max_length=64)], float], Field(max_length=64)] = {}


class AnnotationChanges(Parameters):
    """Changes of an annotation; absent fields stay, null clears ``quality`` and ``superseded_by``."""

    model_config = ConfigDict(strict=True)

    tags: Annotated[
        list[Annotated[str, AfterValidator(_tag)]], Field(max_length=64), BeforeValidator(_as_list)
    ] = []
    notes: Annotated[str, Field(max_length=16_384)] = ""
    pinned: bool = False
    quality: QualityAssessment | None = None
    superseded_by: Annotated[str, Field(max_length=36)] | None = None

    @property
    def values(self) -> dict[str, Any]:
        """The fields that change, with the types of the fields of an ``Annotation``."""
        values = {name: getattr(self, name) for name in self.model_fields_set}
        if "tags" in values:
            values["tags"] = tuple(sorted(set(self.tags)))
        if self.quality is not None:
            values["quality"] = Quality.from_dict(self.quality.model_dump())
        return values


class StaleRevisionError(ConflictError):
    """The annotations were changed since they were read: read them again, then change them."""


@dataclass(frozen=True, slots=True)
class Annotation:
    """One revision of the annotations of a product.

    Attributes
    ----------
    revision : int
        0 if there are no annotations.
    tags : tuple of str
        Sorted, each once.
    notes : str
    pinned : bool
        A pinned product cannot be deleted or retired.
    quality : Quality or None
        Assessment in addition to that of the header.
    superseded_by : str or None
        Id of the product that replaces it.
    author : str
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
        """Return plain data for MessagePack and JSON."""
        return {
            "revision": self.revision,
            "tags": list(self.tags),
            "notes": self.notes,
            "pinned": self.pinned,
            "quality": None if self.quality is None else self.quality.to_dict(),
            "superseded_by": self.superseded_by,
            "author": self.author,
            "stamp_ns": self.stamp_ns,
        }


class AnnotationTable:
    """Annotations of products, append-only."""

    def __init__(self, database: Database, events: EventTable, clock: Clock) -> None:
        self._database = database
        self._events = events
        self._clock = clock

    def get(
        self, product_id: str, as_of_ns: int | None = None, *, connection: Connection | None = None
    ) -> Annotation:
        """Return the last revision at ``as_of_ns``; revision 0 if there is none."""
        with self._database.read(connection) as connection:
            a = schema.annotation_revisions.c
            statement = select(schema.annotation_revisions).where(a.product_id == product_id)
            if as_of_ns is not None:
                statement = statement.where(a.stamp_ns <= as_of_ns)
            row = connection.execute(statement.order_by(a.revision.desc()).limit(1)).first()
            return Annotation(product_id) if row is None else _annotation(row._mapping)

    def history(self, product_id: str) -> tuple[Annotation, ...]:
        """Return all revisions, oldest first."""
        a = schema.annotation_revisions.c
        with self._database.read() as connection:
            rows = connection.execute(
                select(schema.annotation_revisions).where(a.product_id == product_id).order_by(a.revision)
            ).all()
        return tuple(_annotation(row._mapping) for row in rows)

    def update(
        self,
        product_id: str,
        changes: Mapping[str, Any],
        *,
        if_match: int | None,
        author: str = "",
        connection: Connection | None = None,
    ) -> Annotation:
        """Add a revision; fields that are not in ``changes`` stay.

        Parameters
        ----------
        changes : mapping
            Fields of ``AnnotationChanges``; ``quality`` as plain data.
        if_match : int or None
            Revision that the change is based on; None for any.

        Returns
        -------
        Annotation
            The new revision, or the current one if nothing differs.

        Raises
        ------
        InputError
            If a field is unknown or a value invalid.
        ProductNotFoundError
            If the product or its successor is unknown or deleted.
        StaleRevisionError
            If the current revision is not ``if_match``.
        ConflictError
            If the product would become its own successor.
        """
        changed_values, fields = AnnotationChanges.parse(changes).values, AnnotationChanges.model_fields
        if not changed_values:
            raise InputError(f"update: no field, expected some of {', '.join(fields)}")
        with self._database.write(connection) as connection:
            names = _names_of_live(connection, product_id)
            current = self.check_in(connection, product_id, if_match)
            new = replace(current, **changed_values)
            if new == current:
                return current
            stamp_ns = max(self._clock.now_ns(), current.stamp_ns)
            new = replace(new, revision=current.revision + 1, author=author[:256], stamp_ns=stamp_ns)
            if new.superseded_by not in (None, current.superseded_by):
                _check_successor(connection, product_id, str(new.superseded_by))
            _insert(connection, new)
            changed = [name for name in fields if getattr(new, name) != getattr(current, name)]
            revision = {"revision": new.revision, "changed": changed, "author": new.author}
            body = {"id": product_id, **names, **revision}
            self._events.append(names["robot"], "updated", body, stamp_ns, connection=connection)
            return new

    def check_in(self, connection: Connection, product_id: str, if_match: int | None) -> Annotation:
        """Return the current revision; raises StaleRevisionError if it is not ``if_match``."""
        current = self.get(product_id, connection=connection)
        if if_match is not None and if_match != current.revision:
            raise StaleRevisionError(
                f"product {product_id} is at revision {current.revision}, the change is based on {if_match}: "
                "read it again"
            )
        return current

    @staticmethod
    def remove_from_search_in(connection: Connection, product_id: str) -> None:
        """Remove the tags, pin and successor of a deleted product from searches; its revisions stay."""
        for table in (schema.product_tags, schema.pins, schema.supersessions):
            connection.execute(table.delete().where(table.c.product_id == product_id))


def is_pinned(connection: Connection, product_id: str) -> bool:
    """Return whether a product is pinned."""
    p = schema.pins.c.product_id
    return connection.execute(select(p).where(p == product_id)).first() is not None


def has_tag(product_id: ColumnElement[str], tag: str, as_of_ns: int | None = None) -> ColumnElement[bool]:
    """Return the condition that a product has a tag, or had it at ``as_of_ns``."""
    if as_of_ns is None:
        t = schema.product_tags.c
        return product_id.in_(select(t.product_id).where(t.tag == tag))
    # a tag has neither quotes nor backslashes, so that its JSON form is the tag in quotes
    return _last_revision_with(
        product_id, as_of_ns, schema.annotation_revisions.c.tags.contains(f'"{tag}"', autoescape=True)
    )


def has_successor(product_id: ColumnElement[str], as_of_ns: int | None = None) -> ColumnElement[bool]:
    """Return the condition that a product is superseded, or was at ``as_of_ns``."""
    if as_of_ns is None:
        return product_id.in_(select(schema.supersessions.c.product_id))
    return _last_revision_with(product_id, as_of_ns, schema.annotation_revisions.c.superseded_by.is_not(None))


def _last_revision_with(
    product_id: ColumnElement[str], as_of_ns: int, condition: ColumnElement[bool]
) -> ColumnElement[bool]:
    """Return a condition on the last revision at a time."""
    a, other = schema.annotation_revisions.c, schema.annotation_revisions.alias()
    last = select(func.max(other.c.revision)).where(
        other.c.product_id == a.product_id, other.c.stamp_ns <= as_of_ns
    )
    of_product = select(a.product_id).where(a.revision == last.scalar_subquery(), condition)
    return product_id.in_(of_product)


def _insert(connection: Connection, new: Annotation) -> None:
    """Insert a revision of an annotation, and the tags, pins and
    supersessions by which products are found.
    """
    row = {
        **new.to_dict(),
        "product_id": new.product_id,
        "tags": json.dumps(list(new.tags)),
        "quality": None if new.quality is None else msgpack.packb(new.quality.to_dict()),
    }
    connection.execute(insert(schema.annotation_revisions), row)
    AnnotationTable.remove_from_search_in(connection, new.product_id)
    if new.tags:
        connection.execute(
            insert(schema.product_tags), [{"tag": t, "product_id": new.product_id} for t in new.tags]
        )
    if new.pinned:
        connection.execute(insert(schema.pins), {"product_id": new.product_id})
    if new.superseded_by is not None:
        connection.execute(
            insert(schema.supersessions), {"product_id": new.product_id, "by_id": new.superseded_by}
        )


def restore_revision(connection: Connection, row: Mapping[str, Any]) -> None:
    """Insert a row of ``annotations`` of another database as the next revision of its product."""
    a = schema.annotation_revisions.c
    last = select(func.max(a.revision)).where(a.product_id == row["product_id"])
    revision = (connection.execute(last).scalar() or 0) + 1
    _insert(connection, replace(_annotation(row), revision=revision))


def _names_of_live(connection: Connection, product_id: str) -> dict[str, str]:
    p = schema.products.c
    names = select(*(p[name] for name in NAMES)).where(p.id == product_id, p.deleted_ns.is_(None))
    row = connection.execute(names).first()
    if row is None:
        raise ProductNotFoundError(f"no product {product_id[:64]!r}")
    return dict(row._mapping)


def _check_successor(connection: Connection, product_id: str, by_id: str) -> None:
    """Raise an error for an unknown successor, or one that leads back to the product."""
    _names_of_live(connection, by_id)
    s = schema.supersessions.c
    step: str | None = by_id
    while step is not None:
        if step == product_id:
            raise ConflictError(
                f"product {product_id} cannot be superseded by {by_id}: it would become its own successor"
            )
        step = connection.execute(select(s.by_id).where(s.product_id == step)).scalar()


def _annotation(row: Any) -> Annotation:
    packed = row["quality"]
    quality = None if packed is None else Quality.from_dict(msgpack.unpackb(packed))
    return Annotation(**{**row, "tags": tuple(json.loads(row["tags"])), "quality": quality})

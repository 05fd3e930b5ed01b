# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What changes the store: insertions, checked first, deletions, transactions, retention, annotations, records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from cdff_common.codecs import decode
from cdff_common.codecs.encoding import parse_encoding
from cdff_common.codecs.siblings import base_type
from cdff_common.errors import CodecError, InputError, ProductNotFoundError
from cdff_common.interfaces.product import Header, Status
from dpm_store import Annotation, Insertion, Parcel, Plan, Rule
from dpm_store.actor import actor, check_robot
from dpm_store.events import Entry
from dpm_store.transaction import Change, Delete, Insert, Reanchor
from services.dpm.announcing import Announcing
from services.dpm.changes import told
from services.dpm.checks import check_header, check_value
from services.dpm.parameters import GROUND, PRODUCT_TYPES

#: Payloads up to this size are decoded before they are stored, so that what cannot be read is refused.
DECODED_BYTES = 16 << 20


class Writing(Announcing):
    """Operations that change the store; each is durable when it returns."""

    def put(
        self, names: Mapping[str, str], payload: bytes, encoding: str, attachment: bytes
    ) -> tuple[Insertion, Header]:
        """Check and insert a product; durable when this returns.

        Parameters
        ----------
        names : mapping
            robot, dfpc, port, product.
        encoding : str
            As ``application/vnd.cdff+uper;Pointcloud/1``.
        attachment : bytes
            The header.

        Raises
        ------
        CodecError
            If header, encoding or payload cannot be read.
        InputError, ConflictError, StorageError
            As ``Store.put``.
        """
        return self.put_all(((names, payload, encoding, attachment),))[0]

    def put_all(self, given: Sequence[tuple[Mapping[str, str], bytes, str, bytes]]) -> list[tuple[Insertion, Header]]:
        """As ``put`` for several at once: all of them are stored, or none."""
        for names, *_ in given:
            check_robot(names["robot"])
        try:
            parcels = [self.parcel(*one) for one in given]
            insertions = self.store.put_all(parcels)
        except (InputError, KeyError):
            self._count("refused")
            raise
        for insertion in insertions:
            self._count(str(insertion))
        self._tell()
        return [(insertion, parcel.header) for insertion, parcel in zip(insertions, parcels, strict=True)]

    def parcel(self, names: Mapping[str, str], payload: bytes, encoding: str, attachment: bytes) -> Parcel:
        """A product of a put, checked; raises as ``put``."""
        if len(payload) > self.max_payload_bytes:
            raise InputError(f"payload of {len(payload)} bytes: expected at most {self.max_payload_bytes}")
        header = Header.from_attachment(attachment, strict=True)
        check_header(header, self.clock.now_ns())
        self._frames.check_of_robot(header.frame, names["robot"])
        type_name, codec = parse_encoding(encoding)
        value = self._checked_value(names, header, type_name, codec, payload)
        if header.box_m is None and value is not None and (extent := value.extent_m()) is not None:
            header = _with_box(header, extent)
        return Parcel(
            header, payload, names["robot"], names["dfpc"], names["port"], names["product"], type_name, codec, value
        )

    def delete(self, product_id: str, if_match: int | None = None) -> bool:
        """Leave a tombstone; False if it was deleted before. StaleRevisionError if it is not at ``if_match``."""
        check_robot(self.store.get(product_id, deleted=True).robot)
        if if_match is None:
            deleted = self.store.delete(product_id)
        else:
            (outcome,) = self.store.transact([Delete(product_id, if_match)])
            deleted = outcome is True
        self._count("deleted")
        self._tell()
        return deleted

    def purge(self, product_id: str) -> int:
        """Remove the payload of a deleted product; bytes freed."""
        check_robot(self.store.get(product_id, deleted=True).robot)
        freed = self.store.purge(product_id)
        self._tell()
        return freed

    def transact(self, changes: Sequence[Change]) -> list[dict[str, Any]]:
        """Make several changes in one transaction, all or none; what each came to, as plain data."""
        for change in changes:
            check_robot(self._owner(change))
        outcomes = self.store.transact(changes)
        self._tell()
        return [told(outcome) for outcome in outcomes]

    def _owner(self, change: Change) -> str:
        if isinstance(change, Insert):
            return change.parcel.robot
        if isinstance(change, Reanchor):
            return change.frame.split("/")[0]
        try:
            return self.store.get(change.product_id, deleted=True).robot
        except ProductNotFoundError:  # it may come in the same transaction; who inserts it was looked at
            return getattr(actor(), "name", "")

    def retire(self, rules: Sequence[Rule], *, apply: bool = False) -> Plan:
        """What the rules let go; with ``apply`` it is deleted and its payloads are collected."""
        if not apply:
            return self.store.retention.plan(rules)
        check_robot(GROUND)
        plan = self.store.retention.apply(rules)
        self._tell()
        self.store.collect()
        return plan

    def update(self, product_id: str, changes: Mapping[str, Any], if_match: int | None, author: str = "") -> Annotation:
        """Change what is said of a product; see ``AnnotationTable.update``."""
        check_robot(self.store.get(product_id).robot)
        annotation = self.store.annotations.update(product_id, changes, if_match=if_match, author=author)
        self._count("updated")
        self._tell()
        return annotation

    def record(self, scope: str, kind: str, body: Mapping[str, Any]) -> None:
        """Enter an event of another service in the history; listeners hear of it as of ours."""
        self.store.events.append(scope, kind, body)
        self._tell()

    def record_from(self, origin: str, entries: Sequence[Entry]) -> int:
        """Enter another service's journal in the history, each entry once; see ``EventTable.append_from``."""
        last = self.store.events.append_from(origin, entries)
        self._tell()
        return last

    def _checked_value(
        self, names: Mapping[str, str], header: Header, type_name: str, codec: str, payload: bytes
    ) -> Any:
        product = names["product"]
        if product not in PRODUCT_TYPES:
            raise InputError(f"product={product[:80]!r}: expected one of {', '.join(PRODUCT_TYPES)}")
        wanted = PRODUCT_TYPES[product]
        if wanted is not None and base_type(type_name) != wanted:
            raise InputError(f"a {product} is stored as {wanted}, this is a {type_name}")
        if (header.quality.status is Status.FAILED) != (not payload):
            raise InputError(
                f"{header.quality.status} with {len(payload)} bytes: FAILED has no payload, others have one"
            )
        if not payload or len(payload) > DECODED_BYTES:
            return None
        value = decode(type_name, payload, codec)
        check_value(value, header)
        if product == "pose" and (header.frame, header.child) != (value.parent_frame, value.child_frame):
            raise CodecError(
                f"pose of {value.child_frame} in {value.parent_frame}, its header says {header.child} in {header.frame}"
            )
        return value


def _with_box(header: Header, extent: Any) -> Header:
    x0, y0, z0, x1, y1, z1 = (float(v) for v in extent)
    return replace(header, box_m=(x0, y0, z0, x1, y1, z1))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Changes of the store: checked insertions, deletions, transactions, retention, annotations, journals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from cdff_common.codecs import decode, parse_encoding
from cdff_common.codecs.wire_types import base_type
from cdff_common.contract.names import GROUND
from cdff_common.contract.products import product_type
from cdff_common.errors import ClockSkewError, CodecError, InputError, ProductNotFoundError, StorageError
from cdff_common.interfaces.product import Header, Status
from dpm_store import Annotation, Event, Insertion, NewProduct, RetentionPlan, Rule, Store
from dpm_store.history.events import actor, check_robot
from dpm_store.products.transaction import Change, Delete, Reanchor
from services.alarms import Alarms, Severity
from services.dpm.operations.checks import FrameNames, check_header, check_value
from services.dpm.operations.clock_guard import ClockGuard
from services.dpm.operations.event_publisher import EventPublisher
from services.dpm.operations.transactions import outcome_dict
from services.dpm.operations.work_budget import WorkBudget

_SKEW_REMEDY = "set the clocks of the robot and of the DPM; the product waits at the robot"
#: Payloads up to this size are decoded before they are stored: the store does not trust its clients.
DECODED_BYTES = 16 << 20
#: Memory of a decoded value, in multiples of the payload.
_DECODED_COPIES = 4


def _insertion_bytes(payload_bytes: int) -> int:
    """Return the memory of an insertion: the payload, and its value if it is decoded."""
    return payload_bytes + (_DECODED_COPIES * payload_bytes if payload_bytes <= DECODED_BYTES else 0)


class StoreWriter:
    """Operations that change the store; each is durable when it returns."""

    def __init__(
        self,
        store: Store,
        events: EventPublisher,
        frame_names: FrameNames,
        max_payload_bytes: int,
        alarms: Alarms,
        budget: WorkBudget,
    ) -> None:
        self._budget = budget
        self.clock_guard = ClockGuard(store, alarms)
        self._alarms = alarms
        self._store = store
        self._events = events
        self._frame_names = frame_names
        self.max_payload_bytes = max_payload_bytes

    def put(
        self, names: Mapping[str, str], payload: bytes, encoding: str, attachment: bytes
    ) -> tuple[Insertion, Header]:
        """Check and insert a product; durable when this returns.

        Parameters
        ----------
        names : mapping
            robot, dfpc, port, product.
        encoding : str
            Encoding string, e.g. ``application/vnd.cdff+uper;Pointcloud/1``.
        attachment : bytes
            The header.

        Raises
        ------
        CodecError
            If header, encoding or payload cannot be read.
        InputError, ConflictError, StorageError
            As ``Store.put_all``.
        ClockSkewError
            If the product was captured in the future; see ``check_header``.
        """
        return self.put_all(((names, payload, encoding, attachment),))[0]

    def put_all(
        self, batch: Sequence[tuple[Mapping[str, str], bytes, str, bytes]]
    ) -> list[tuple[Insertion, Header]]:
        """Insert several products, all or none; raises like ``put``."""
        for names, *_ in batch:
            check_robot(names["robot"])
        nbytes = sum(_insertion_bytes(len(payload)) for _, payload, *_ in batch)
        self._budget.charge(nbytes, is_insertion=True)
        try:
            products = [self.checked_product(*item) for item in batch]
            insertions = self._store.put_all(products)
        except ClockSkewError as error:
            self._events.count("skewed")
            self._alarms.set("clock_skew", batch[0][0]["robot"], Severity.WARNING, str(error), _SKEW_REMEDY)
            raise
        except (InputError, StorageError, KeyError):
            self._events.count("refused")
            raise
        for names, *_ in batch:
            self._alarms.clear("clock_skew", names["robot"])
        for insertion in insertions:
            self._events.count(str(insertion))
        self._events.publish()
        return [(insertion, product.header) for insertion, product in zip(insertions, products, strict=True)]

    def checked_product(
        self, names: Mapping[str, str], payload: bytes, encoding: str, attachment: bytes
    ) -> NewProduct:
        """Return a product that may be stored; raises like ``put``."""
        if len(payload) > self.max_payload_bytes:
            raise InputError(f"payload of {len(payload)} bytes: expected at most {self.max_payload_bytes}")
        header = Header.from_attachment(attachment, strict=True)
        check_header(header, self._store.clock.now_ns())
        self._frame_names.check_of_robot(header.frame, names["robot"])
        type_name, codec = parse_encoding(encoding)
        value = self._checked_value(names, header, type_name, codec, payload)
        if header.box_m is None and value is not None and (extent := value.extent_m()) is not None:
            header = _with_box(header, extent)
        return NewProduct(header, payload, **names, type_name=type_name, codec=codec, value=value)

    def delete(self, product_id: str, if_match: int | None = None) -> bool:
        """Delete a product and leave a tombstone; return False if it was already deleted.

        Raises
        ------
        StaleRevisionError
            If its annotation is not at revision ``if_match``.
        """
        check_robot(self._store.get(product_id, deleted=True).robot)
        if if_match is None:
            deleted = self._store.delete(product_id)
        else:
            (outcome,) = self._store.transact([Delete(product_id, if_match)])
            deleted = outcome is True
        self._events.count("deleted")
        self._events.publish()
        return deleted

    def purge(self, product_id: str) -> int:
        """Remove the payload of a deleted product; return the bytes freed."""
        check_robot(self._store.get(product_id, deleted=True).robot)
        freed = self._store.purge(product_id)
        self._events.publish()
        return freed

    def transact(self, changes: Sequence[Change]) -> list[dict[str, Any]]:
        """Apply several changes in one transaction, all or none; return the outcomes in JSON form."""
        for change in changes:
            check_robot(self._owner(change))
        outcomes = self._store.transact(changes)
        self._events.publish()
        return [outcome_dict(outcome) for outcome in outcomes]

    def _owner(self, change: Change) -> str:
        if isinstance(change, NewProduct):
            return change.robot
        if isinstance(change, Reanchor):
            return change.frame.split("/")[0]
        try:
            return self._store.get(change.product_id, deleted=True).robot
        except ProductNotFoundError:  # the same transaction may insert it; that change is checked
            return getattr(actor(), "name", "")

    def retire(self, rules: Sequence[Rule], *, apply: bool = False) -> RetentionPlan:
        """Return what the rules retire; with ``apply`` delete it and collect its payloads.

        Raises
        ------
        UnavailableError
            If products would be deleted while the mission clock is not confirmed.
        """
        if not apply:
            return self._store.retention.plan(rules)
        check_robot(GROUND)
        self.clock_guard.check()
        plan = self._store.retention.apply(rules)
        self._events.publish()
        self._store.collect()
        return plan

    def update(
        self, product_id: str, changes: Mapping[str, Any], if_match: int | None, author: str = ""
    ) -> Annotation:
        """Change the annotation of a product; see ``AnnotationTable.update``."""
        check_robot(self._store.get(product_id).robot)
        annotation = self._store.annotations.update(product_id, changes, if_match=if_match, author=author)
        self._events.count("updated")
        self._events.publish()
        return annotation

    def record(self, scope: str, kind: str, body: Mapping[str, Any]) -> None:
        """Add an event of another service to the history and publish it to listeners."""
        self._store.events.append(scope, kind, body)
        self._events.publish()

    def record_from(self, origin: str, entries: Sequence[Event]) -> int:
        """Add journal entries of another service to the history, each once; see
        ``EventTable.append_from``.
        """
        last = self._store.events.append_from(origin, entries)
        self._events.publish()
        return last

    def _checked_value(
        self, names: Mapping[str, str], header: Header, type_name: str, codec: str, payload: bytes
    ) -> Any:
        product = names["product"]
        expected_type = product_type(product, "product").type_name
        if expected_type is not None and base_type(type_name) != expected_type:
            raise InputError(f"a {product} is stored as {expected_type}, this is a {type_name}")
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
                f"pose of {value.child_frame} in {value.parent_frame}, its header names "
                f"{header.child} in {header.frame}"
            )
        return value


def _with_box(header: Header, extent: Any) -> Header:
    x0, y0, z0, x1, y1, z1 = (float(v) for v in extent)
    return replace(header, box_m=(x0, y0, z0, x1, y1, z1))

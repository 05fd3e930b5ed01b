# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Annotations and deletions of the products of a robot, exchanged in both directions.

Only changes that a caller made are exchanged: products that retention deletes on the robot stay at the
ground, and the reverse. A field of an annotation that was changed at the ground belongs to the ground: a
change of the robot has no effect on it, and the robot gets the value of the ground.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Collection, Mapping
from typing import Any

from cdff_common.errors import (
    CdffError,
    CodecError,
    ConflictError,
    InputError,
    ProductNotFoundError,
    StorageError,
)
from dpm_store import Event, Store
from dpm_store.exchange.ledger import ChangeRow, Ledger
from dpm_store.history.events import Actor, acting
from dpm_store.products.annotations import StaleRevisionError
from services.contact.packets import CHUNK_BYTES
from services.dpm.operations.dpm import Dpm

logger = logging.getLogger(__name__)

KINDS = ("updated", "deleted")
#: Name of the note with the ordinal of the oldest product that a robot has not sent.
OLDEST = "oldest"
#: Interface of the changes that the exchange makes, in the actors of the history.
VIA = "contact"
#: Events that are read at once, and products that one request deletes: their ids fit in a datagram.
_PAGE, _IDS = 1000, 12
#: Largest length of a reason, characters: the answer of the robot fits in a datagram.
_REASON = 400


def is_exchanged(event: Event) -> bool:
    """Return whether an event is a change of a product that a caller made here."""
    by = str(event.body.get("by", ""))
    return event.kind in KINDS and bool(by) and not by.startswith(f"{VIA}/")


def with_values(event: Event, store: Store) -> Event:
    """Return a change with the values of the fields of the annotation that it changed.

    If the revision is missing, the values are those of the newest one; without any the product is purged.
    """
    if event.kind != "updated":
        return event
    body = event.body
    revisions = store.annotations.history(str(body["id"]))
    if not revisions:
        logger.warning("change of product %s is not sent: its annotations were purged", body["id"])
        return Event(event.ordinal, event.stamp_ns, event.scope, event.kind, {**body, "values": {}})
    values = next((a for a in revisions if a.revision == body["revision"]), revisions[-1]).to_dict()
    changed = {name: values[name] for name in body["changed"] if name in values}
    return Event(event.ordinal, event.stamp_ns, event.scope, event.kind, {**body, "values": changed})


def apply_on_robot(dpm: Dpm, body: Mapping[str, str]) -> dict[str, Any]:
    """Apply a change of the ground on the robot; return the answer of the request.

    Raises
    ------
    CodecError
        If the change cannot be read.
    ConflictError
        If products refuse the change, such as the deletion of a pinned product. The others are changed.
    StorageError
        If the disk is full or fails.
    """
    try:
        is_update = body["change"] == "update"
        values = dict(json.loads(body["values"]).items()) if is_update else {}
        ids = [body["id"]] if is_update else body["ids"].split(",")
    except (AttributeError, KeyError, ValueError) as error:
        raise CodecError(f"change {str(body)[:200]} cannot be read: {error!r}") from error
    refused = []
    with acting(Actor("ground", "operator", VIA)):
        for product_id in ids:
            try:
                if is_update:
                    dpm.writer.update(product_id, values, None, body.get("author", ""))
                else:
                    dpm.writer.delete(product_id)
            except ProductNotFoundError:
                continue  # the robot has deleted it, or never had it
            except StorageError:
                raise
            except CdffError as error:
                refused.append(str(error))
    if refused:
        raise ConflictError("; ".join(refused)[:_REASON])
    return {}


class GroundChanges:
    """The changes at the ground: those of robots are applied, those of the ground become requests.

    Parameters
    ----------
    robots : collection of str
        Robots of the contact plan.
    add_request : callable
        Keeps a request: robot, id, body.
    """

    def __init__(self, dpm: Dpm, ledger: Ledger, robots: Collection[str], add_request: Any) -> None:
        self._dpm, self._store, self._ledger = dpm, dpm.store, ledger
        self._robots, self._add_request = frozenset(robots), add_request
        if ledger.note("changes_scanned") is None:
            ledger.set_note("changes_scanned", self._store.events.last_ordinal())

    def scan(self) -> None:
        """Keep a request for each change that was made here since the last call."""
        last = self._ledger.note("changes_scanned", 0)
        while events := self._store.events.since(last, limit=_PAGE):
            own = [e for e in events if e.scope in self._robots and is_exchanged(e)]
            with self._ledger.transaction():
                for event in own:
                    if event.kind == "updated":
                        self._ledger.set_owned(str(event.body["id"]), list(event.body["changed"]))
                        self._send_values(event, list(event.body["changed"]))
                for robot in {event.scope for event in own}:
                    self._send_deletions([e for e in own if e.kind == "deleted" and e.scope == robot])
                last = events[-1].ordinal
                self._ledger.set_note("changes_scanned", last)

    def receive(self, robot: str, events: Collection[Event]) -> None:
        """Keep the changes of a robot until they are applied."""
        rows = []
        for e in events:
            product_id, values = e.body.get("id"), e.body.get("values", {})
            if e.kind in KINDS and e.scope == robot and isinstance(values, dict):
                rows.append(ChangeRow(e.ordinal, str(product_id), e.kind, values))
        self._ledger.add_changes(robot, rows)

    def apply(self, robot: str, is_coming: Callable[[str], bool] = lambda _: False) -> None:
        """Apply the changes of a robot whose products are here; the others wait for their product.

        Changes of products that were deleted here have no effect, and those of products that the robot will
        not send: it has sent all products that are older than the change, and ``is_coming`` is false.
        """
        rows = self._ledger.changes(robot)
        if not rows:
            return
        self.scan()
        live = self._store.live({row.product_id for row in rows})
        oldest = self._ledger.note(f"{OLDEST}/{robot}", 0)
        for row in rows:
            if row.product_id in live:
                has_ended = self._apply_one(robot, row)
            else:
                is_sent = row.ordinal < oldest and not is_coming(row.product_id)
                has_ended = is_sent or self._is_deleted(row.product_id)
            if has_ended:
                self._ledger.remove_change(robot, row.ordinal)

    def _is_deleted(self, product_id: str) -> bool:
        """Return whether the ground has deleted a product."""
        try:
            self._store.get(product_id, deleted=True)
        except ProductNotFoundError:
            return False
        return True

    def _apply_one(self, robot: str, row: ChangeRow) -> bool:
        """Apply a change; return False if it must be tried again."""
        try:
            with acting(Actor(robot, "robot", VIA)):
                if row.kind == "deleted":
                    self._dpm.writer.delete(row.product_id)
                else:
                    self._update(robot, row)
        except StorageError:
            raise
        except (StaleRevisionError, ProductNotFoundError):
            return False  # changed at the ground meanwhile, or its successor is not here yet
        except CdffError as error:
            self._report(robot, row, error)
        return True

    def _update(self, robot: str, row: ChangeRow) -> None:
        revision = self._store.annotations.get(row.product_id).revision
        self.scan()
        owned = self._ledger.owned(row.product_id)
        values = {name: value for name, value in row.values.items() if name not in owned}
        if values:
            self._dpm.writer.update(row.product_id, values, revision, robot)
        if refused := sorted(set(row.values) & owned):
            present = self._store.annotations.get(row.product_id).to_dict()
            body = {name: present[name] for name in refused}
            self._request_update(
                robot, row.product_id, body, f"back_{row.product_id}_{row.ordinal}", present["author"]
            )

    def _report(self, robot: str, row: ChangeRow, error: CdffError) -> None:
        """Enter a change that has no effect here in the history."""
        logger.warning("change of product %s of %s is not applied: %s", row.product_id, robot, error)
        body = {"id": row.product_id, "change": row.kind, "reason": str(error)[:_REASON]}
        self._dpm.writer.record(robot, "change_refused", body)

    def _send_values(self, event: Event, names: list[str]) -> None:
        values = with_values(event, self._store).body["values"]
        changed = {name: values[name] for name in names if name in values}
        author = str(event.body.get("author", ""))
        self._request_update(event.scope, str(event.body["id"]), changed, f"{event.ordinal:012}", author)

    def _request_update(
        self, robot: str, product_id: str, values: Mapping[str, Any], name: str, author: str
    ) -> None:
        """Keep a request for each field: a datagram has space for one value.

        The order of the ids of requests is that of the changes, because a paused mission clock gives them
        one time.
        """
        for field, value in values.items():
            text = json.dumps({field: value})
            body = {"type": "change", "change": "update", "id": product_id, "values": text}
            body["author"] = author[:80]
            if sum(map(len, (*body, *body.values()))) > CHUNK_BYTES // 2:
                error = InputError(f"{field} of {len(text)} bytes: a change for a robot fits in one datagram")
                self._report(robot, ChangeRow(0, product_id, "updated", {}), error)
                continue
            self._add_request(robot, f"change_{name}_{field}", body)

    def _send_deletions(self, events: list[Event]) -> None:
        for first in range(0, len(events), _IDS):
            some = events[first : first + _IDS]
            ids = ",".join(str(event.body["id"]) for event in some)
            body = {"type": "change", "change": "delete", "ids": ids}
            self._add_request(some[0].scope, f"change_{some[0].ordinal:012}_delete", body)

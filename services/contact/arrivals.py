# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Storage of the received items of one robot: records with their payloads, events, frame revisions."""

from __future__ import annotations

import hashlib
import logging
import threading
from collections import Counter
from dataclasses import dataclass
from typing import Any

from cdff_common.clock import monotonic_s
from cdff_common.codecs import encoding_string
from cdff_common.errors import (
    CdffError,
    ClockSkewError,
    CodecError,
    FrameNotFoundError,
    InputError,
    StorageError,
    UnavailableError,
)
from dpm_store.exchange.ledger import AnnouncedRow, Ledger
from dpm_store.history.events import Actor, acting
from dpm_store.products.records import NAMES
from services.contact.changes import KINDS, GroundChanges
from services.contact.conditions import ExchangeAlarms
from services.contact.packets import Item, ReceivedRecord, item_of, unpack_events
from services.dpm.operations.dpm import Dpm
from services.dpm.queries.bodies import FrameRevisionBody

logger = logging.getLogger(__name__)

#: Time between attempts to store products that the store cannot take now.
_RETRY_S = 5.0
#: Bytes of products that wait for the store, beyond which further packets are ignored.
_MAX_WAITING_BYTES = 32 << 20
#: Fields of a frame revision that are set; the others follow from the store.
_FRAME_FIELDS = ("frame", "parent", "T", "covariance", "valid_from_ns", "valid_until_ns", "producer")


@dataclass(frozen=True, slots=True)
class _Complete:
    """A product of which everything is here."""

    ordinal: int
    record: ReceivedRecord
    payload: bytes

    @property
    def keys(self) -> list[int]:
        return [Item.RECORD.key(self.ordinal), Item.PAYLOAD.key(self.ordinal)]


class Arrivals:
    """Complete items of one robot that wait for the next commit.

    Parameters
    ----------
    lock : RLock
        Held by the caller of each method but ``store``.

    Attributes
    ----------
    counters : Counter
        Products ``stored``, ``already`` stored before, and ``refused`` permanently.
    storage_error : StorageError or None
        Why the store did not take the last products.
    """

    def __init__(
        self,
        robot: str,
        dpm: Dpm,
        ledger: Ledger,
        alarms: ExchangeAlarms,
        lock: threading.RLock,
        changes: GroundChanges,
    ) -> None:
        self._changes = changes
        self._lock, self._generation = lock, 0
        self._robot, self._dpm, self._ledger, self._alarms = robot, dpm, ledger, alarms
        self._records: dict[int, ReceivedRecord] = {}
        self._new_records: dict[int, tuple[ReceivedRecord, bytes]] = {}
        self._payloads: dict[int, bytes] = {}  # of records that are still to come
        self._complete: dict[int, _Complete] = {}
        self._bundles: dict[int, bytes] = {}
        self._void: list[int] = []
        self._retry_s = 0.0
        self._waiting_bytes = 0
        self.storage_error: StorageError | None = None
        self.counters: Counter[str] = Counter()
        for row in ledger.announced(robot):
            self._records[row.ordinal] = ReceivedRecord(row.body)

    def add(self, key: int, content: bytes) -> None:
        """Add a complete item; raises CodecError if it cannot be read."""
        kind, ordinal = item_of(key)
        match kind:
            case Item.RECORD:
                self._add_record(ordinal, content)
            case Item.PAYLOAD:
                self._payloads[ordinal] = content
                self._join(ordinal)
            case Item.EVENTS:
                unpack_events(content)
                self._bundles[ordinal] = content

    def holds(self, key: int) -> bool:
        """Return whether an item is here and waits for the commit, or for its record."""
        kind, ordinal = item_of(key)
        if kind is Item.EVENTS:
            return ordinal in self._bundles
        if kind is Item.PAYLOAD:
            return ordinal in self._complete or ordinal in self._payloads
        return ordinal in self._complete or ordinal in self._new_records

    def lacks_record(self, key: int) -> bool:
        """Return whether an item is a payload whose record is not here.

        The robot sends no record twice. The ground lacks it if it ended between the storage of the product
        and the report, or if its ledger was removed.
        """
        kind, ordinal = item_of(key)
        return kind is Item.PAYLOAD and ordinal not in self._records and ordinal not in self._complete

    @property
    def is_waiting(self) -> bool:
        """True while the store cannot take products: what arrives now would only use memory."""
        return self._waiting_bytes > _MAX_WAITING_BYTES

    def announced(self, ordinal: int) -> ReceivedRecord | None:
        """Return a record whose payload is still to come."""
        return self._records.get(ordinal)

    def store(self) -> list[int]:
        """Store the complete items; return the keys of the items that are durable now.

        The lock is not held while the store works, so that packets are acknowledged meanwhile.
        """
        with self._lock:
            generation = self._generation
            bundles, records = dict(self._bundles), dict(self._new_records)
            products = list(self._complete.values()) if monotonic_s() >= self._retry_s else []
        self._store_events(bundles)
        stored = self._store_products(products) if products else []
        self._changes.apply(self._robot, self._is_here)
        with self._lock:
            if generation != self._generation:  # the keys belong to another store now
                return []
            for key in bundles:
                self._bundles.pop(key, None)
            done = [Item.EVENTS.key(ordinal) for ordinal in bundles]
            rows = [
                AnnouncedRow(o, record.priority, record.size, body)
                for o, (record, body) in records.items()
                if o in self._new_records
            ]
            if rows:
                self._ledger.announce(self._robot, rows)
                done += [Item.RECORD.key(row.ordinal) for row in rows]
                for row in rows:
                    self._new_records.pop(row.ordinal, None)
            if stored:
                done += self._remove(stored)
            self._waiting_bytes = sum(len(product.payload) for product in self._complete.values())
        return done

    def take_void(self) -> list[int]:
        """Return the keys of payloads that differ from their digests, which must be sent again."""
        void, self._void = self._void, []
        return void

    def clear(self) -> None:
        """Discard everything that is not stored."""
        self._generation += 1
        for table in (self._records, self._new_records, self._payloads, self._complete, self._bundles):
            table.clear()

    def _is_here(self, product_id: str) -> bool:
        """Return whether a record of a product is here and waits for its payload or for the store."""
        with self._lock:
            complete = (product.record for product in self._complete.values())
            return any(record.id == product_id for record in (*self._records.values(), *complete))

    def _add_record(self, ordinal: int, content: bytes) -> None:
        record = ReceivedRecord(content)
        if record.names["robot"] != self._robot:
            raise CodecError(f"a record of {record.names['robot'][:64]!r} came from {self._robot}")
        if ordinal in self._records:
            self._new_records[ordinal] = (record, content)
            return
        if record.payload is not None:
            self._complete[ordinal] = _Complete(ordinal, record, record.payload)
        elif self._dpm.store.live([record.id]):
            self._complete[ordinal] = _Complete(ordinal, record, self._dpm.store.payload(record.id))
        else:
            self._records[ordinal] = record
            self._new_records[ordinal] = (record, content)
            self._join(ordinal)

    def _join(self, ordinal: int) -> None:
        """Join a record and its payload when both are here."""
        record, payload = self._records.get(ordinal), self._payloads.get(ordinal)
        if record is None or payload is None:
            return
        del self._payloads[ordinal]
        if hashlib.sha256(payload).hexdigest() == record.sha256:
            self._complete[ordinal] = _Complete(ordinal, record, payload)
        else:
            logger.warning("payload of product %s of %s is damaged: sent again", record.id, self._robot)
            self.counters["damaged"] += 1
            self._void.append(Item.PAYLOAD.key(ordinal))

    def _store_products(self, products: list[_Complete]) -> list[_Complete]:
        """Store products together, or one by one if one of them is refused."""
        done: list[_Complete] = []
        self.storage_error = None
        try:
            done += self._put(products)
        except CdffError:
            for product in products:
                try:
                    done += self._put([product])
                except (StorageError, UnavailableError, ClockSkewError) as error:
                    self._retry_s = monotonic_s() + _RETRY_S
                    if isinstance(error, StorageError):
                        self.storage_error = error
                    logger.info("product %s of %s waits: %s", product.record.id, self._robot, error)
                except CdffError as error:
                    done.append(product)
                    self._refuse(product, error)
        return done

    def _remove(self, done: list[_Complete]) -> list[int]:
        """Remove products that are stored or refused; return their keys."""
        self._ledger.remove_announced(self._robot, [product.ordinal for product in done])
        for product in done:
            for table in (self._complete, self._records, self._new_records, self._payloads):
                table.pop(product.ordinal, None)
        return [key for product in done for key in product.keys]

    def _put(self, products: list[_Complete]) -> list[_Complete]:
        from cdff_common.interfaces.product import Header

        batch = [
            (
                {name: product.record.names[name] for name in NAMES},
                product.payload,
                encoding_string(product.record.names["type_name"], product.record.names["codec"]),
                Header.from_dict(product.record.fields).to_attachment(),
            )
            for product in products
        ]
        with acting(Actor(self._robot, "robot", "contact")):
            results = self._dpm.writer.put_all(batch)
        for insertion, _ in results:
            self.counters["stored" if str(insertion) == "inserted" else "already"] += 1
        return products

    def _refuse(self, product: _Complete, error: CdffError) -> None:
        """Report a product that this store can never take; the robot keeps it."""
        self.counters["refused"] += 1
        logger.error("product %s of %s is refused: %s", product.record.id, self._robot, error)
        self._alarms.product_refused(self._robot, error)

    def _store_events(self, bundles: dict[int, bytes]) -> None:
        for _, content in sorted(bundles.items()):
            events, revisions = unpack_events(content)
            with acting(Actor(self._robot, "robot", "contact")):
                for revision in revisions:
                    self._set_frame(revision)
                self._changes.receive(self._robot, events)
                applied = ("reanchored", *KINDS)
                entries = [e for e in events if e.scope == self._robot and e.kind not in applied]
                if entries:
                    self._dpm.writer.record_from(f"contact/{self._robot}", entries)

    def _set_frame(self, revision: dict[str, Any]) -> None:
        """Set a frame of the robot, unless its revision of this number has the same content."""
        body = FrameRevisionBody.parse({name: revision[name] for name in _FRAME_FIELDS})
        try:
            own = self._dpm.store.frames.revisions(body.frame)
        except FrameNotFoundError:
            own = ()
        same = [r for r in own if r.revision == revision["revision"]]
        names = ("parent", "T", "covariance", "valid_from_ns", "valid_until_ns")
        if same and all(same[0].to_dict()[name] == revision[name] for name in names):
            return
        try:
            self._dpm.frames.set_frame(body.frame, body, body.producer or f"{self._robot}/contact")
        except InputError as error:
            logger.warning("frame %s of %s is refused: %s", body.frame, self._robot, error)

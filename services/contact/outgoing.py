# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Items that the store of a robot has to send: those of its new products, events and frame revisions."""

from __future__ import annotations

import uuid
from collections.abc import Iterable

from cdff_common.errors import ProductNotFoundError, StorageError
from cdff_common.interfaces.profile import Exchange
from dpm_store import Event
from dpm_store.exchange.ledger import Ledger, OutboxRow, Ranges
from services.contact.changes import is_exchanged, with_values
from services.contact.packets import INLINE_BYTES, Item, item_of, pack_events, pack_record
from services.contact.sender import Sender
from services.dpm.operations.dpm import Dpm

#: Events in one bundle, and events of the store that are read at once.
_BUNDLE, _PAGE = 100, 1000
#: Priorities of urgent, small and other products; the records of all are sent with the small ones at latest.
URGENT, SMALL, LARGE = 0, 1, 2
#: Kinds of events that are not sent, except annotations and deletions by callers: insertions are items of
#: their own, and the ground keeps the products that retention deletes.
_NOT_SENT = frozenset({"inserted", "updated", "deleted"})
#: Bytes of a payload that are read from the store at once.
_BLOCK = 1 << 16


class Outgoing:
    """Items of the products and events of one robot.

    Attributes
    ----------
    store_id : str
        Name of this store, to which the ordinals belong.
    """

    def __init__(self, robot: str, dpm: Dpm, ledger: Ledger, exchange: Exchange) -> None:
        self._robot, self._store, self._ledger, self._exchange = robot, dpm.store, ledger, exchange
        self.store_id: str = ledger.note("store_id") or str(uuid.uuid4())
        ledger.set_note("store_id", self.store_id)
        self.sender = Sender(self._read, self._size, self._remove_void)
        self._contents: dict[int, bytes] = {}
        self._block: tuple[int, int, bytes] = (-1, 0, b"")
        self._products: dict[int, OutboxRow] = {}
        self._bundle: tuple[int, int] | None = None  # ordinals of the first and the last event
        self._progress: dict[str, int] = ledger.note("progress", {})
        self.sender.expect({int(key): end for key, end in self._progress.items()})
        for row in ledger.outbox():
            self._add(row)

    def scan(self) -> None:
        """Add the products that were stored, and the events that happened, since the last call."""
        while events := self._store.events.since(self._ledger.note("scanned", 0), limit=_PAGE):
            rows = list(self._rows(events))
            with self._ledger.transaction():
                self._ledger.add_to_outbox(rows)
                self._ledger.set_note("scanned", events[-1].ordinal)
            for row in rows:
                self._add(row)
        if self._bundle is None:
            self._next_bundle()
        self._note_progress()

    def done(self, keys: Iterable[int]) -> None:
        """Remove items that the ground has stored."""
        announced, stored = [], []
        for key in keys:
            kind, ordinal = item_of(key)
            self.sender.remove(key)
            self._contents.pop(key, None)
            if kind is Item.EVENTS:
                if self._bundle is not None and self._bundle[0] == ordinal:
                    self._ledger.set_note("events_sent", self._bundle[1])
                    self._bundle = None
                    self._next_bundle()
            elif (row := self._products.get(ordinal)) is None:
                continue
            elif kind is Item.PAYLOAD or row.size <= INLINE_BYTES:
                stored.append(ordinal)
                self.sender.remove(Item.RECORD.key(ordinal))
                del self._products[ordinal]
            elif not row.announced:
                announced.append(ordinal)
                self._products[ordinal] = row._replace(announced=True)
        if announced or stored:
            with self._ledger.transaction():
                self._ledger.set_announced(announced)
                self._ledger.remove_from_outbox(stored)

    def want(self, key: int, missing: Ranges) -> None:
        """Send intervals of an item again, or a whole record that the ground has no longer."""
        kind, ordinal = item_of(key)
        row = self._products.get(ordinal)
        if kind is Item.RECORD and row is not None and row.announced:
            self._add(row._replace(announced=False))
        else:
            self.sender.want(key, missing)

    def prioritise(self, product_id: str) -> None:
        """Send a product before all others, because it was requested."""
        ordinal = self._ledger.prioritise(product_id)
        row = None if ordinal is None else self._products.get(ordinal)
        if row is not None and row.priority != URGENT:
            self._add(row._replace(priority=URGENT))

    def backlog(self) -> dict[int, list[int]]:
        """Return number and bytes of the products to send, by priority."""
        totals: dict[int, list[int]] = {}
        for row in self._products.values():
            total = totals.setdefault(row.priority, [0, 0])
            total[0] += 1
            total[1] += row.size
        return totals

    @property
    def oldest(self) -> int:
        """Ordinal of the oldest product to send; all older ones are at the ground, or will not be sent."""
        return min(self._products, default=self._ledger.note("scanned", 0) + 1)

    def _note_progress(self) -> None:
        """Note how far large items were sent, in blocks and one block more, so that it is written rarely.

        A later process starts there until the ground reports its intervals.
        """
        ends = {key: end for key, end in self._progress.items() if int(key) in self.sender}
        ends |= {str(key): (end // _BLOCK + 2) * _BLOCK for key, end in self.sender.progress().items()}
        if ends != self._progress:
            self._ledger.set_note("progress", ends)
            self._progress = ends

    def _rows(self, events: Iterable[Event]) -> Iterable[OutboxRow]:
        for event in events:
            if event.kind != "inserted" or event.body.get("robot") != self._robot:
                continue
            try:
                record = self._store.get(str(event.body["id"]))
            except ProductNotFoundError:
                continue  # deleted before it was sent
            yield OutboxRow(
                event.ordinal, self._priority(record.product, record.size), record.id, record.size
            )

    def _priority(self, product: str, size: int) -> int:
        if product in self._exchange.urgent:
            return URGENT
        return SMALL if size <= self._exchange.small_bytes else LARGE

    def _add(self, row: OutboxRow) -> None:
        self._products[row.ordinal] = row
        if not row.announced:
            self.sender.add(Item.RECORD.key(row.ordinal), min(row.priority, SMALL))
        if row.size > INLINE_BYTES:
            self.sender.add(Item.PAYLOAD.key(row.ordinal), row.priority)

    def _next_bundle(self) -> None:
        last = self._ledger.note("events_sent", 0)
        while events := self._store.events.since(last, limit=_PAGE):
            sent = [e for e in events if self._is_sent(e)][:_BUNDLE]
            last = sent[-1].ordinal if len(sent) == _BUNDLE else events[-1].ordinal
            if sent:
                revisions = [r for e in sent if e.kind == "reanchored" for r in self._revisions(e)]
                key = Item.EVENTS.key(sent[0].ordinal)
                self._bundle = (sent[0].ordinal, last)
                self._contents[key] = pack_events([with_values(e, self._store) for e in sent], revisions)
                self.sender.add(key, URGENT)
                return
            self._ledger.set_note("events_sent", last)

    def _is_sent(self, event: Event) -> bool:
        return event.scope == self._robot and (event.kind not in _NOT_SENT or is_exchanged(event))

    def _revisions(self, event: Event) -> list[dict[str, object]]:
        revisions = self._store.frames.revisions(str(event.body["frame"]))
        return [r.to_dict() for r in revisions if r.revision == event.body["revision"]]

    def _size(self, key: int) -> int | None:
        """Return the size of an item, whose content is prepared now; None if the product was deleted."""
        kind, ordinal = item_of(key)
        if kind is Item.EVENTS:
            return len(self._contents[key])
        row = self._products[ordinal]
        try:
            record = self._store.get(row.product_id)
            if kind is Item.PAYLOAD:
                return record.size
            payload = self._store.payload(row.product_id) if row.size <= INLINE_BYTES else None
        except (ProductNotFoundError, StorageError):
            return None
        self._contents[key] = pack_record(record, row.priority, payload)
        return len(self._contents[key])

    def _read(self, key: int, offset: int, length: int) -> bytes:
        content = self._contents.get(key)
        if content is not None:
            return content[offset : offset + length]
        known, start, block = self._block
        if known != key or not start <= offset <= offset + length <= start + len(block):
            try:
                block = self._store.payload(self._products[item_of(key)[1]].product_id, offset, _BLOCK)
            except (ProductNotFoundError, StorageError):
                self.sender.remove(key)
                self._remove_void(key)
                return b""
            start = offset
            self._block = (key, start, block)
        return block[offset - start : offset - start + length]

    def _remove_void(self, key: int) -> None:
        """Stop sending a product that was deleted or is damaged here."""
        _, ordinal = item_of(key)
        for other in (Item.RECORD.key(ordinal), Item.PAYLOAD.key(ordinal)):
            self.sender.remove(other)
        if self._products.pop(ordinal, None) is not None:
            self._ledger.remove_from_outbox([ordinal])

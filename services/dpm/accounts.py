# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the DPM says of what it holds: status, changes, history, provenance, as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cdff_common.errors import InputError
from dpm_store import Event, ProductRecord
from dpm_store.events import CHANGES
from dpm_store.provenance import MAX_GENERATIONS
from services.dpm.announcing import Announcing


class Accounts(Announcing):
    """Operations that tell of products without handing them out."""

    def described(self, product_id: str) -> dict[str, Any]:
        """Metadata of a product with what is said of it."""
        record = self.store.get(product_id)
        return record.to_dict() | {"annotation": self.store.annotations.get(product_id).to_dict()}

    def history(self, since: int, limit: int, kinds: Sequence[str] = (), scope: str | None = None) -> dict[str, Any]:
        """Everything that happened after an event's ordinal: insertions, audit entries, other services' decisions."""
        return _listing(self.store.events.since(since, kind=kinds or None, scope=scope, limit=limit), since, limit)

    def changes(self, since: int, limit: int = 1000, kinds: Sequence[str] = CHANGES) -> dict[str, Any]:
        """What has changed after an event's ordinal; ``next`` is where to go on, itself where nothing has."""
        if not set(kinds) <= set(CHANGES) or not kinds:
            raise InputError(f"kind={','.join(kinds)[:80]!r}: expected some of {', '.join(CHANGES)}")
        events = self.store.events.since(since, kind=kinds, limit=limit)
        return _listing(events, since, limit)

    def provenance(self, product_id: str, direction: str = "up", depth: int = MAX_GENERATIONS) -> dict[str, Any]:
        """What a product was made from, or what was made from it, as plain data."""
        found = self.store.lineage(product_id, direction, depth)
        items = []
        for generation, ids in enumerate(found.generations, 1):
            for i in ids:
                record = found.records.get(i)
                known = {"known": False} if record is None else {"known": True, **_summary(record)}
                items.append({"id": i, "generation": generation, **known})
        links = [{"product": made, "input": used} for made, used in found.links]
        return {
            "id": product_id, "direction": str(found.direction), "items": items, "links": links,
            "truncated": found.truncated,
        }  # fmt: skip

    def status(self) -> dict[str, Any]:
        """Counts and sizes, as plain data."""
        s = self.store.statistics()
        by_robot: dict[str, dict[str, int]] = {}
        for (robot, product), count in sorted(s.products.items()):
            by_robot.setdefault(robot, {})[product] = count
        bytes_by_robot: dict[str, dict[str, int]] = {}
        for (robot, product), size in sorted(s.product_bytes.items()):
            bytes_by_robot.setdefault(robot, {})[product] = size
        return {
            "products": s.count, "by_robot": by_robot, "payload_bytes": s.payload_bytes,
            "payloads": s.payloads, "stored_bytes": s.stored_bytes, "free_bytes": s.free_bytes,
            "bytes_by_robot": bytes_by_robot, "newest_t1_ns": s.newest_t1_ns,
            "events": s.events, "now_ns": self.clock.now_ns(), "counters": dict(self.counters),
            **{name: dict(counts()) for name, counts in self.counted.items()},
        }  # fmt: skip


def _listing(events: Sequence[Event], since: int, limit: int) -> dict[str, Any]:
    items = [{**e.body, "ordinal": e.ordinal, "stamp_ns": e.stamp_ns, "scope": e.scope, "kind": e.kind} for e in events]
    return {"items": items, "next": events[-1].ordinal if events else since, "more": len(events) == limit}


def _summary(record: ProductRecord) -> dict[str, Any]:
    header = record.header
    return {
        "robot": record.robot, "dfpc": record.dfpc, "port": record.port, "product": record.product,
        "t0_ns": header.t0_ns, "t1_ns": header.t1_ns, "producer": header.producer, "config_hash": header.config_hash,
        "status": str(header.quality.status), "deleted_ns": record.deleted_ns,
    }  # fmt: skip

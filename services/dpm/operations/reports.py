# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reports on the store: status, changes, history, provenance, in JSON form."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cdff_common.contract.limits import MAX_GENERATIONS
from cdff_common.errors import InputError
from cdff_common.loops import Loops
from dpm_store import Event, ProductRecord, Store
from dpm_store.history.events import CHANGES
from services.dpm.operations.alarm_board import AlarmBoard
from services.dpm.operations.event_publisher import EventPublisher


class Reports:
    """Reports on products and events."""

    def __init__(self, store: Store, events: EventPublisher, alarms: AlarmBoard, loops: Loops) -> None:
        self._alarms, self._loops = alarms, loops
        self._sections: dict[str, Callable[[], Any]] = {}
        self._store = store
        self._events = events

    def add(self, name: str, section: Callable[[], Any]) -> None:
        """Add a section to ``status``; it is computed with each report."""
        self._sections[name] = section

    def history(
        self, since: int, limit: int, kinds: Sequence[str] = (), scope: str | None = None
    ) -> dict[str, Any]:
        """Return every event after an ordinal: insertions, audit entries, decisions of other services."""
        return _listing(
            self._store.events.since(since, kind=kinds or None, scope=scope, limit=limit), since, limit
        )

    def changes(self, since: int, limit: int = 1000, kinds: Sequence[str] = CHANGES) -> dict[str, Any]:
        """Return the changes after an ordinal; ``next`` is the ordinal to continue from."""
        if not set(kinds) <= set(CHANGES) or not kinds:
            raise InputError(f"kind={','.join(kinds)[:80]!r}: expected some of {', '.join(CHANGES)}")
        events = self._store.events.since(since, kind=kinds, limit=limit)
        return _listing(events, since, limit)

    def provenance(
        self, product_id: str, direction: str = "up", depth: int = MAX_GENERATIONS
    ) -> dict[str, Any]:
        """Return the inputs of a product (``up``) or its results (``down``) through all generations."""
        lineage = self._store.lineage(product_id, direction, depth)
        items = []
        for generation, ids in enumerate(lineage.generations, 1):
            for i in ids:
                record = lineage.records.get(i)
                known = {"known": False} if record is None else {"known": True, **_summary(record)}
                items.append({"id": i, "generation": generation, **known})
        links = [{"product": product, "input": used} for product, used in lineage.links]
        return {
            "id": product_id,
            "direction": lineage.direction,
            "items": items,
            "links": links,
            "truncated": lineage.truncated,
        }

    def status(self) -> dict[str, Any]:
        """Return counts and sizes."""
        statistics = self._store.statistics()
        return {
            "products": statistics.count,
            "by_robot": _by_robot(statistics.products),
            "payload_bytes": statistics.payload_bytes,
            "payloads": statistics.payloads,
            "stored_bytes": statistics.stored_bytes,
            "free_bytes": statistics.free_bytes,
            "bytes_by_robot": _by_robot(statistics.product_bytes),
            "newest_t1_ns": statistics.newest_t1_ns,
            "events": statistics.events,
            "now_ns": self._store.clock.now_ns(),
            "alarms": self._alarms.active(),
            "loops": self._loops.describe(),
            "counters": dict(self._events.counters),
            **{name: section() for name, section in self._sections.items()},
            **{name: dict(counts()) for name, counts in self._events.other_counters.items()},
        }


def _by_robot(numbers: Mapping[tuple[str, str], int]) -> dict[str, dict[str, int]]:
    """Return numbers by robot and product type as nested maps."""
    nested: dict[str, dict[str, int]] = {}
    for (robot, product), number in sorted(numbers.items()):
        nested.setdefault(robot, {})[product] = number
    return nested


def _listing(events: Sequence[Event], since: int, limit: int) -> dict[str, Any]:
    items = [event.to_dict() for event in events]
    return {"items": items, "next": events[-1].ordinal if events else since, "more": len(events) == limit}


def _summary(record: ProductRecord) -> dict[str, Any]:
    header = record.header
    return {
        **record.names,
        "t0_ns": header.t0_ns,
        "t1_ns": header.t1_ns,
        "producer": header.producer,
        "config_hash": header.config_hash,
        "status": str(header.quality.status),
        "deleted_ns": record.deleted_ns,
    }

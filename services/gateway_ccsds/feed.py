# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reading of the products and alarms of the DPM in the order of their events, continued after a restart."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from cdff_common.client import Client
from cdff_common.client.answer import Answer
from cdff_common.clock import NS_PER_S
from cdff_common.errors import InputError, ProductNotFoundError, StorageError
from cdff_common.output import replace_file
from services.gateway_ccsds.settings import ProductFile
from services.gateway_ccsds.spool import Spool

logger = logging.getLogger(__name__)

_KINDS = ("inserted", "alarm")
#: Largest number of events that one call returns.
_LIMIT = 200
#: Priority of products that a command has requested.
ASKED = 0


class Feed:
    """Reader of the events of a robot and of the ground, which adds products to the spool.

    Parameters
    ----------
    robot : str
    client : Client
    spool : Spool
    products : sequence of ProductFile
        Product types that are sent.
    position : Path
        File of the ordinal of the last event that was read.
    spool_bytes : int
        Size of the spool at which the reading of events pauses.
    on_alarm : callable
        Called with the body of each event of an alarm.

    Attributes
    ----------
    counters : Counter
        Products that were ``spooled``; ``thinned``: omitted because of ``every_s``; ``removed`` from the DPM
        before they were read; ``failed``: not convertible to the format.
    """

    def __init__(
        self,
        robot: str,
        client: Client,
        spool: Spool,
        products: tuple[ProductFile, ...],
        position: Path,
        spool_bytes: int,
        on_alarm: Callable[[Mapping[str, Any]], None],
    ) -> None:
        self._robot, self._client, self._spool = robot, client, spool
        self._products = {entry.type: (priority, entry) for priority, entry in enumerate(products, 1)}
        self._path, self._spool_bytes, self._on_alarm = position, spool_bytes, on_alarm
        self._last_ns: dict[tuple[str, str, str], int] = {}
        self.counters: Counter[str] = Counter()
        try:
            self.position = int(position.read_text(encoding="ascii")) if position.exists() else None
        except (OSError, ValueError) as error:
            raise StorageError(
                f"{position}: {error}; remove it to continue with new products only"
            ) from error

    def skip(self) -> None:
        """Set the position to the newest event: a first start without ``backlog`` omits stored products."""
        position = 0
        while events := self._client.history(kinds=_KINDS, since=position, limit=1000):
            position = events[-1]["ordinal"]
        self._store(position)

    def read(self) -> bool:
        """Process the next events; return whether there may be more. Raises CdffError."""
        if self._spool.size()[1] >= self._spool_bytes:
            return False
        events = self._client.history(kinds=_KINDS, since=self.position or 0, limit=_LIMIT)
        for event in events:
            if event["scope"] not in (self._robot, "ground"):
                continue
            if event["kind"] == "alarm":
                self._on_alarm(event)
            elif event["product"] in self._products and not self._is_thinned(event):
                priority, entry = self._products[event["product"]]
                self._add(event, min(priority, 9), entry.format)
        if events:
            self._store(events[-1]["ordinal"])
        return len(events) == _LIMIT

    def send(self, product_id: str, form: str | None = None) -> None:
        """Add a stored product to the spool, with the highest priority.

        Raises
        ------
        ProductNotFoundError
            If the DPM has no such product of the robot.
        InputError
            If it cannot be converted to the format.
        """
        answer = self._client.get(product_id, form)
        if answer.robot not in ("", self._robot):
            raise ProductNotFoundError(f"no product {product_id!r} of {self._robot}: it is of {answer.robot}")
        self.add(answer, answer.type_name.rpartition("/")[2].lower(), {"dfpc": answer.header.producer}, form)

    def add(
        self,
        answer: Answer,
        product: str,
        names: Mapping[str, Any],
        form: str | None,
        *,
        priority: int = ASKED,
        ordinal: int = 0,
    ) -> None:
        """Add a product to the spool; ``names`` are further fields of its sidecar."""
        header = answer.header
        name = f"{self._robot}-{product}-{header.t1_ns // NS_PER_S}-{header.id}"
        suffix = form or answer.encoding.rpartition("+")[2].partition(";")[0]
        fields = {
            "robot": self._robot,
            "product": product,
            **names,
            "encoding": answer.encoding,
            **header.to_dict(),
            "product_sha256": header.sha256,
        }
        if self._spool.add(ordinal, priority, name, suffix, answer.data, fields):
            self.counters["spooled"] += 1

    def _is_thinned(self, event: Mapping[str, Any]) -> bool:
        """Return whether less than ``every_s`` has passed since the previous product of its producer."""
        key = (event["dfpc"], event["port"], event["product"])
        every_s = self._products[event["product"]][1].every_s
        t1_ns = int(event["t1_ns"])
        if t1_ns - self._last_ns.get(key, -1 << 62) < every_s * NS_PER_S:
            self.counters["thinned"] += 1
            return True
        self._last_ns[key] = t1_ns
        return False

    def _add(self, event: Mapping[str, Any], priority: int, form: str | None) -> None:
        try:
            answer = self._client.get(str(event["id"]), form)
            names = {"dfpc": event["dfpc"], "port": event["port"]}
            self.add(answer, event["product"], names, form, priority=priority, ordinal=event["ordinal"])
        except ProductNotFoundError:
            self.counters["removed"] += 1
        except InputError as error:
            self.counters["failed"] += 1
            logger.error("product %s cannot be sent: %s", event["id"], error)

    def _store(self, position: int) -> None:
        self.position = position
        replace_file(self._path, str(position).encode(), sync=True)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Newest products of a robot's own DFPCs, from the bus, for the time in which no DPM can be reached.

The orchestrator of a robot that is out of contact with the ground serves them as they are. Meanwhile the
hosts of the DFPCs keep all products for the DPM (``services.dfpc_host.outbox``).
"""

from __future__ import annotations

import threading

from cdff_common.bus import Bus, Message, keys
from cdff_common.codecs import decode_payload
from cdff_common.interfaces.product import Header
from cdff_core.orchestration.world import ProviderId
from services.orchestrator.dpm import StoredProduct
from services.orchestrator.state import SystemState


class BusProducts:
    """Subscription of all products of a robot; the newest message of each output port is kept."""

    def __init__(self, bus: Bus, robot: str, state: SystemState) -> None:
        self._bus, self._robot, self._state = bus, robot, state
        self._lock = threading.Lock()
        self._newest: dict[
            str, dict[tuple[str, str], tuple[Header, Message]]
        ] = {}  # by product, DFPC and port
        self._has_dpm = False

    def start(self) -> None:
        """Subscribe."""
        self._bus.watch_alive(keys.alive(keys.GROUND, "dpm"), self._on_dpm)
        self._bus.subscribe(keys.product(self._robot, "*", "*"), self._on_product)

    def newest(self, product: str, child: str | None = None) -> StoredProduct | None:
        """Return the newest usable product of a type, a pose of ``child``; None if there is none."""
        with self._lock:
            received = list(self._newest.get(product, {}).values())
        usable = [pair for pair in received if child in (None, pair[0].child)]
        if not usable:
            return None
        header, message = max(usable, key=lambda pair: pair[0].t1_ns)
        return StoredProduct(
            header=header,
            robot=self._robot,
            value=decode_payload(message.payload, message.encoding),
            manifest={**header.to_dict(), "robot": self._robot, "product": product},
            payload=message.payload,
            encoding=message.encoding,
        )

    def _on_dpm(self, _: str, is_alive: bool) -> None:
        self._has_dpm = is_alive

    def _on_product(self, message: Message) -> None:
        _, _, _, _, dfpc, port = message.key.split("/")
        product = self._state.product_of(ProviderId(self._robot, dfpc), port)
        if product and message.payload:  # a FAILED product has none
            header = Header.from_attachment(message.attachment)
            with self._lock:
                self._newest.setdefault(product, {})[dfpc, port] = (header, message)
            if not self._has_dpm:  # otherwise the event of the insertion follows
                self._state.add_insertion(self._robot, product)

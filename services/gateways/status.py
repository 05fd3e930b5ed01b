# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Status of a gateway: the counters of each topic and request, for its key and the metrics."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from services.gateways.inputs import InputLink
from services.gateways.outputs import OutputLink
from services.gateways.requests import ProductRequests


def status_of(
    inputs: Iterable[InputLink],
    outputs: Iterable[OutputLink],
    requests: Iterable[ProductRequests],
    overflow: Callable[[InputLink], int] = lambda _: 0,
) -> dict[str, Any]:
    """Return the counters of links; ``overflow`` counts messages that a full queue has dropped."""
    by_topic = {}
    for link in inputs:
        counters, entry = link.counters.to_map(), link.entry
        lost = {"queue": overflow(link), "bus": link.sensor.status.dropped}
        counters["dropped"] |= {reason: count for reason, count in lost.items() if count}
        name = f"{entry.topic} {entry.stream}" if entry.is_frame_tree else entry.topic
        by_topic[name] = {"type": entry.type, "stream": entry.stream, **counters}
    products = [
        {"product": o.entry.product, "topic": o.entry.topic, "type": o.entry.type, **o.counters.to_map()}
        for o in outputs
    ]
    asked = [{"name": r.entry.name, "type": r.entry.type, **r.counters.to_map()} for r in requests]
    return {"inputs": by_topic, "outputs": products, "requests": asked}

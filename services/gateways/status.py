# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Status of a gateway: the counters of each topic and request, for its key and the metrics."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from typing import Any

from services.gateways.inputs import InputLink
from services.gateways.outputs import OutputLink
from services.gateways.requests import ProductRequests


def status_of(
    inputs: Iterable[InputLink],
    outputs: Iterable[OutputLink],
    requests: Iterable[ProductRequests],
    overflow: Callable[[InputLink], int] = lambda _: 0,
    missed: Callable[[str, Collection[str]], int] = lambda _, __: 0,
) -> dict[str, Any]:
    """Return the counters of links.

    Parameters
    ----------
    overflow : callable
        Number of messages of an input that a full queue has dropped.
    missed : callable
        Number of messages of an output topic that slow subscribers have not received, without those of the
        other output topics.
    """
    by_topic = {}
    for link in inputs:
        counters, entry = link.counters.to_map(), link.entry
        lost = {"queue": overflow(link), "bus": link.sensor.status.dropped}
        counters["dropped"] |= {reason: count for reason, count in lost.items() if count}
        name = f"{entry.topic} {entry.stream}" if entry.is_frame_tree else entry.topic
        by_topic[name] = {"type": entry.type, "stream": entry.stream, **counters}
    products, topics = [], set()
    outputs = list(outputs)
    declared = {output.entry.topic for output in outputs}
    for output in outputs:
        counters, product = output.counters.to_map(), output.entry
        # Several products of a topic share its subscribers; the first has their count.
        count = 0 if product.topic in topics else missed(product.topic, declared)
        topics.add(product.topic)
        counters["dropped"] |= {"slow_subscriber": count} if count else {}
        products.append(
            {"product": product.product, "topic": product.topic, "type": product.type, **counters}
        )
    asked = [{"name": r.entry.name, "type": r.entry.type, **r.counters.to_map()} for r in requests]
    return {"inputs": by_topic, "outputs": products, "requests": asked}

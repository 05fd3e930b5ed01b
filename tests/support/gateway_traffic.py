# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products for a gateway and samples from it on the bus, and a gateway that runs in a thread."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol

import numpy as np

from cdff_common.bus import Bus, Message, keys
from cdff_common.clock import wall_ns
from cdff_common.codecs import encode_payload
from cdff_common.interfaces.product import Header, product_id
from cdff_common.raster import GridGeometry
from cdff_common.types import NavigationMap
from services.dfpc_host.inputs import decode_sample


class RunnableGateway(Protocol):
    """The part of a gateway that tests run."""

    def run(self, stop: threading.Event) -> None: ...

    def problem(self) -> str: ...


@contextmanager
def gateway_in_thread(gateway: RunnableGateway) -> Iterator[None]:
    """Run a gateway in a thread; fail if one of its threads has ended at the end of the context."""
    stop = threading.Event()
    thread = threading.Thread(target=gateway.run, args=(stop,))
    thread.start()
    try:
        yield
        assert gateway.problem() == ""
    finally:
        stop.set()
        thread.join()


def collect_samples(bus: Bus, stream: str, type_name: str) -> list[Any]:
    """Return a list to which the values of the samples of a stream ``sensor/stream`` of mana are appended."""
    samples: list[Any] = []

    def on_sample(message: Message) -> None:
        samples.append(decode_sample(message, stream, type_name).value)

    bus.subscribe(keys.sensor("mana", *stream.split("/")), on_sample)
    return samples


def publish_product(
    bus: Bus, product: str, value: Any, stamp_ns: int, *, frame: str, child: str | None = None, seq: int = 0
) -> None:
    """Publish a value as a product ``dfpc/port`` of mana with a stamp in nanoseconds."""
    dfpc, port = product.split("/")
    header = Header(
        id=product_id("mana", dfpc, port, stamp_ns, seq, ""),
        seq=seq,
        t0_ns=stamp_ns,
        t1_ns=stamp_ns,
        frame=frame,
        child=child,
        producer=dfpc,
    )
    payload, encoding = encode_payload(value)
    key = keys.product("mana", dfpc, port)
    bus.publish(key, payload, encoding=encoding, attachment=header.to_attachment())


def publish_navigation_map(bus: Bus) -> None:
    """Publish a navigation map of 2 x 3 cells of 0.5 m with the classes 0 to 3 in the frame ``site``."""
    stamp_ns = wall_ns() // 1000 * 1000
    classes = np.array([[0, 1, 2], [3, 1, 1]], np.uint8)
    grid = GridGeometry("site", 0.5, 1.0, 2.0, 2, 3)
    value = NavigationMap.from_layers(grid, {"class": classes}, t0_ns=stamp_ns, t1_ns=stamp_ns)
    publish_product(bus, "navigation_mapping/navigation_map", value, stamp_ns, frame="site")

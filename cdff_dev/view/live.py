# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensor samples, products, states and events of the running system, as they are published."""

from __future__ import annotations

import logging
import queue
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import unpack
from cdff_common.codecs import decode_payload, parse_encoding
from cdff_common.codecs.wire_types import base_type
from cdff_common.errors import CdffError
from cdff_common.interfaces.product import Header
from cdff_dev.logs.source import LogSample
from cdff_dev.view.drawings import Layer, Note, Number

logger = logging.getLogger(__name__)

#: Most messages that wait to be drawn; a full queue discards the newest ones.
_WAITING = 256
#: Numbers of the status of a DFPC that are plotted.
_PLOTTED = ("mean_step_cpu_s", "pending", "dropped")

#: A sample, or a layer from a mission time on.
Update = LogSample | tuple[int, Layer]


def live_updates(connect: str | None, duration_s: float | None = None) -> Iterator[Update]:
    """Yield the samples of all sensors, the products and states of all DFPCs, and the events.

    Ends when the duration is over. Messages that arrive faster than they are drawn are discarded; their
    number is logged at the end.
    """
    waiting: queue.Queue[Message] = queue.Queue(_WAITING)
    discarded = 0

    def take(message: Message) -> None:
        nonlocal discarded
        try:
            waiting.put_nowait(message)
        except queue.Full:
            discarded += 1

    end_s = None if duration_s is None else time.monotonic() + duration_s
    with Bus.open(connect, name="cdff view") as bus:
        clock, states = bus.mission_clock, States()
        for key in (
            keys.sensor("*", "*", "*"),
            keys.product("*", "*", "*"),
            keys.dfpc_status("*", "*"),
            keys.event("*", "*"),
        ):
            bus.subscribe(key, take)
        try:
            while end_s is None or time.monotonic() < end_s:
                with suppress(queue.Empty):
                    message = waiting.get(timeout=0.2)
                    try:
                        updates = [*updates_of(message, clock.now_ns(), states)]
                    except (CdffError, KeyError, TypeError, ValueError) as error:
                        logger.warning("%s is not shown: %s", message.key, error)
                        continue
                    yield from updates
        finally:
            if discarded:
                logger.warning(
                    "%d messages arrived faster than they were drawn, and are not shown", discarded
                )


def updates_of(message: Message, now_ns: int, states: States) -> Iterator[Update]:
    """Yield the sample or the layers of a message; raises CdffError if it is malformed.

    ``now_ns`` is the mission time, at which states and events are shown.
    """
    _, _, scope, kind, *rest = message.key.split("/")
    if kind == "event":
        yield now_ns, _event_layer(scope, rest[0], unpack(message.payload))
    elif kind == "dfpc":
        for layer in states.layers(f"/{scope}/{rest[0]}", unpack(message.payload)):
            yield now_ns, layer
    else:
        yield _sample_of(message, f"/{scope}/{rest[0]}.{rest[1]}")


def _sample_of(message: Message, stream: str) -> LogSample:
    """Return the sample of a message; its value is None for a product that is FAILED."""
    header = Header.from_attachment(message.attachment)
    type_name, _ = parse_encoding(message.encoding)
    value = decode_payload(message.payload, message.encoding) if message.payload else None
    return LogSample(stream, base_type(type_name), header.t1_ns, header.seq, value, header)


def _event_layer(scope: str, kind: str, body: Mapping[str, Any]) -> Layer:
    """Return the message of an event; alarms are warnings until they end."""
    is_warning = kind == "refused" or (kind == "alarm" and body.get("active", True))
    values = (f"{name} {value}" for name, value in body.items() if value not in (None, "", [], {}))
    text = f"{kind}: {', '.join(values)}"
    return Layer(f"/{scope}/events/{kind}", "", Note("WARN" if is_warning else "INFO", text))


class States:
    """Turns the repeated status of DFPCs into plots, and into messages when state or error change."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[str, str]] = {}

    def layers(self, path: str, status: Mapping[str, Any]) -> Iterator[Layer]:
        """Yield the numbers of a status, and a message if it is another one than before."""
        for name in _PLOTTED:
            if isinstance(number := status.get(name), (int, float)):
                yield Layer(f"{path}/timing/{name}", "", Number(float(number)))
        state, error = str(status.get("state", "")), str(status.get("last_error", ""))
        if self._last.get(path) != (state, error):
            self._last[path] = (state, error)
            text = f"{path.rsplit('/', 1)[-1]} is {state}" + (f": {error}" if error else "")
            yield Layer(f"{path}/notes", "", Note("WARN" if error else "INFO", text))

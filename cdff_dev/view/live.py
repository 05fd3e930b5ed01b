# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensor samples, products, states and events of the running system, as they are published."""

from __future__ import annotations

import logging
import queue
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from typing import Any

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import unpack
from cdff_common.codecs import decode_payload, parse_encoding
from cdff_common.codecs.wire_types import base_type
from cdff_common.errors import CdffError
from cdff_common.interfaces.product import Header
from cdff_common.mission_clock import ClockState
from cdff_dev.logs.source import LogSample
from cdff_dev.view.drawings import Layer, Note, Number

logger = logging.getLogger(__name__)

#: Most messages that wait to be drawn; a full queue discards the newest ones.
_WAITING = 256
#: Numbers of the status of a DFPC that are plotted.
_PLOTTED = ("mean_step_cpu_s", "pending", "dropped")
#: Event that a player repeats with its progress.
_PROGRESS = "playback"

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
        timeline = Timeline()
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
                        now_ns = None if clock.state == ClockState.WALL else clock.now_ns()
                        updates = [*timeline.placed(updates_of(message, states), now_ns)]
                    except (CdffError, KeyError, TypeError, ValueError) as error:
                        logger.warning("%s is not shown: %s", message.key, error)
                        continue
                    yield from updates
        finally:
            if discarded:
                logger.warning(
                    "%d messages arrived faster than they were drawn, and are not shown", discarded
                )


def updates_of(message: Message, states: States) -> Iterator[LogSample | Layer]:
    """Yield the sample or the layers of a message; raises CdffError if it is malformed."""
    _, _, scope, kind, *key_end = message.key.split("/")
    if kind == "event":
        if key_end[0] == _PROGRESS:
            return
        yield _event_layer(scope, key_end[0], unpack(message.payload))
    elif kind == "dfpc":
        yield from states.layers(f"/{scope}/{key_end[0]}", unpack(message.payload))
    else:
        yield _sample_of(message, f"/{scope}/{key_end[0]}.{key_end[1]}")


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


class Timeline:
    """Gives states and events their time: that of the mission clock, otherwise of the newest sample.

    Before both are known they wait, because the wall clock can be years from the mission time.
    """

    def __init__(self) -> None:
        self._newest_ns: int | None = None
        self._waiting: dict[str, Layer] = {}

    def placed(self, updates: Iterable[LogSample | Layer], now_ns: int | None) -> Iterator[Update]:
        """Yield samples, and layers with their time; of the waiting layers of a name, only the last."""
        for update in updates:
            if isinstance(update, LogSample):
                self._newest_ns = max(update.stamp_ns, self._newest_ns or update.stamp_ns)
                yield from self.end(now_ns or self._newest_ns)
                yield update
            elif (stamp_ns := now_ns or self._newest_ns) is None:
                self._waiting[update.path] = update
            else:
                yield from self.end(stamp_ns)
                yield stamp_ns, update

    def end(self, stamp_ns: int) -> Iterator[Update]:
        """Yield the layers that wait, at a time."""
        waiting, self._waiting = self._waiting, {}
        for layer in waiting.values():
            yield stamp_ns, layer


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

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensor samples and products of the running system, as they are published."""

from __future__ import annotations

import logging
import queue
import time
from collections.abc import Iterator
from contextlib import suppress

from cdff_common.bus import Bus, Message, keys
from cdff_common.codecs import decode_payload, parse_encoding
from cdff_common.codecs.wire_types import base_type
from cdff_common.errors import CdffError
from cdff_common.interfaces.product import Header
from cdff_dev.logs.source import LogSample

logger = logging.getLogger(__name__)

#: Most samples that wait to be drawn; a full queue discards the newest ones.
_WAITING = 256


def live_samples(connect: str | None, duration_s: float | None = None) -> Iterator[LogSample]:
    """Yield the samples of all sensors and the products of all DFPCs, until the duration is over.

    Samples that arrive faster than they are drawn are discarded; their number is logged at the end.
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
        for key in (keys.sensor("*", "*", "*"), keys.product("*", "*", "*")):
            bus.subscribe(key, take)
        try:
            while end_s is None or time.monotonic() < end_s:
                with suppress(queue.Empty):
                    message = waiting.get(timeout=0.2)
                    if (sample := _sample_of(message)) is not None:
                        yield sample
        finally:
            if discarded:
                logger.warning("%d samples arrived faster than they were drawn, and are not shown", discarded)


def _sample_of(message: Message) -> LogSample | None:
    """Return the sample of a message; None, with a warning, if it cannot be read or has no value."""
    _, _, robot, _, owner, item = message.key.split("/")
    try:
        header = Header.from_attachment(message.attachment)
        type_name, _ = parse_encoding(message.encoding)
        value = decode_payload(message.payload, message.encoding) if message.payload else None
    except CdffError as error:
        logger.warning("%s: %s", message.key, error)
        return None
    if value is None:
        return None
    name = f"/{robot}/{owner}.{item}"
    return LogSample(name, base_type(type_name), header.t1_ns, header.seq, value, header)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Inputs of a hosted DFPC: samples decoded from messages, and products read from the DPM."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from cdff_common.bus import Bus, Message, Reply, keys
from cdff_common.bus.message import on_map
from cdff_common.codecs import decode, parse_encoding
from cdff_common.codecs.wire_types import base_type
from cdff_common.contract.wiring import Source
from cdff_common.errors import CdffError, CodecError, ProductNotFoundError, RefusedError
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.product import Header, Status

logger = logging.getLogger(__name__)

#: Interval between failed reads, and timeout of a call, seconds.
_RETRY_S, _CALL_S = 5.0, 10.0


def decode_sample(message: Message, port: str, type_name: str) -> Sample:
    """Decode a message for a port of type ``type_name``.

    Raises
    ------
    CodecError
        If encoding, attachment or payload do not fit the port.
    RefusedError
        If the producer reported FAILED: the message has no value.
    """
    header = Header.from_attachment(message.attachment)
    if header.quality.status is Status.FAILED:
        raise RefusedError(f"{message.key}: its producer reports FAILED", header.quality.reasons)
    name, codec = parse_encoding(message.encoding)
    if base_type(name) != type_name:
        raise CodecError(f"{message.key} carries {name}, port {port} takes {type_name}")
    return Sample(
        port=port,
        stamp_ns=header.t1_ns,
        seq=header.seq,
        value=decode(name, message.payload, codec),
        id=header.id,
        frame=header.frame,
        child=header.child or "",
        quality=header.quality,
    )


class StoredInput:
    """Reader of the source ``dpm/{robot}/{product}``; replaces a subscription.

    It reads on activation of the DFPC, and again when a new product is stored. A ``dem`` is the map of all
    stored patches of the robot, in frame ``site``; of other products the newest is read.

    Parameters
    ----------
    bus : Bus
    source : str
        Source as in the profile; robot ``any`` selects all robots.
    port : str
        ``dfpc.port``, for log messages.
    on_message : callable
        Called with each product read, as a message.

    Attributes
    ----------
    waiting_reason : str
        Reason why nothing has been read; empty after a read.
    """

    dropped = 0

    def __init__(self, bus: Bus, source: str, port: str, on_message: Callable[[Message], None]) -> None:
        parsed = Source.parse(source)
        self._robot, self._product = parsed.owner, parsed.item
        self._bus, self._source, self._port, self._on_message = bus, source, port, on_message
        self.waiting_reason = ""
        self._reads = 0
        self._id = ""
        self._closed = False
        self._changed = threading.Event()
        self._subscription = bus.subscribe(keys.event("*", "inserted"), on_map(self._on_inserted))
        self._thread = threading.Thread(target=self._run, name=f"read {port}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop reading."""
        self._closed = True
        self._changed.set()
        self._subscription.close()
        if self._thread is not threading.current_thread():
            self._thread.join(timeout=1.0)

    def _on_inserted(self, _key: str, event: Mapping[str, Any]) -> None:
        if event.get("product") == self._product and self._robot in ("any", event.get("robot")):
            self._changed.set()

    def _run(self) -> None:
        while not self._closed:
            self._changed.clear()
            wait_s = None
            try:
                self._forward(self._read())
            except CdffError as error:
                wait_s = _RETRY_S
                if self.waiting_reason != str(error):
                    self.waiting_reason = str(error)
                    logger.warning("%s", error)
            self._changed.wait(wait_s)

    def _read(self) -> Reply:
        """Return the stored product; raises ProductNotFoundError with advice, or the error of the call."""
        parameters = {"type": self._product, "robot": self._robot}
        try:
            return self._bus.call(keys.dpm_rpc(keys.GROUND, "get"), parameters, timeout_s=_CALL_S)
        except ProductNotFoundError as error:
            raise ProductNotFoundError(
                f"{self._port}: the DPM holds no {self._product} of {self._robot} yet "
                f"({self._source}); store one "
                f"with cdff dpm put FILE --robot {self._robot} --type {self._product}; it is read once stored"
            ) from error

    def _forward(self, reply: Reply) -> None:
        header = Header.from_dict(reply.attachment)
        self.waiting_reason = ""
        if self._closed or header.id == self._id:
            return
        self._id, self._reads = header.id, self._reads + 1
        numbered = replace(header, seq=self._reads)
        logger.info("%s: read %s of %s from the DPM", self._port, self._product, self._robot)
        self._on_message(Message(self._source, reply.payload, reply.encoding, numbered.to_attachment()))

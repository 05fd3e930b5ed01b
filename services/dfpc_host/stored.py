# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An input that the DPM holds: read when its DFPC becomes active, and again where another of its kind is stored."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace

from cdff_common.bus import Bus, Message, Reply, keys
from cdff_common.bus.message import unpack
from cdff_common.errors import CdffError, CodecError, ProductNotFoundError
from cdff_common.interfaces.product import Header

logger = logging.getLogger(__name__)

#: How often the DPM is asked while nothing could be read, and how long a call may take, seconds.
_RETRY_S, _CALL_S = 5.0, 10.0


class StoredInput:
    """``dpm/{robot}/{product}`` of a profile; in place of a subscription.

    Of ``dem`` all that the DPM holds of the robot is taken as one map, in frame ``site``; of other products the newest.

    Parameters
    ----------
    source : str
        As the profile says it; robot ``any`` for all.
    port : str
        ``dfpc.port``, for messages.
    take : callable
        Gets what was read as a message.
    """

    dropped = 0

    def __init__(self, bus: Bus, source: str, port: str, take: Callable[[Message], None]) -> None:
        _, self._robot, self._product = source.split("/")
        self._bus, self._source, self._port, self._take = bus, source, port, take
        #: Why what the DPM holds has not been read; empty once it has.
        self.waits = ""
        self._read = 0
        self._id = ""
        self._closed = False
        self._news = threading.Event()
        self._subscription = bus.subscribe(keys.event("*", "inserted"), self._on_inserted)
        self._thread = threading.Thread(target=self._run, name=f"read {port}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Read no more."""
        self._closed = True
        self._news.set()
        self._subscription.close()
        if self._thread is not threading.current_thread():
            self._thread.join(timeout=1.0)

    def _on_inserted(self, message: Message) -> None:
        try:
            body = unpack(message.payload)
        except CodecError:
            return
        told = body if isinstance(body, Mapping) else {}
        if told.get("product") == self._product and self._robot in ("any", told.get("robot")):
            self._news.set()

    def _run(self) -> None:
        while not self._closed:
            self._news.clear()
            wait_s = None
            try:
                self._hand_on(self._asked())
            except CdffError as error:
                wait_s = _RETRY_S
                if self.waits != str(error):
                    self.waits = str(error)
                    logger.warning("%s", error)
            self._news.wait(wait_s)

    def _asked(self) -> Reply:
        """What the DPM holds; raises ProductNotFoundError that says what to do, or what the call raises."""
        asked = {"type": self._product, "robot": self._robot}
        try:
            return self._bus.call(keys.dpm_rpc(keys.GROUND, "get"), asked, timeout_s=_CALL_S)
        except ProductNotFoundError as error:
            raise ProductNotFoundError(
                f"{self._port}: the DPM holds no {self._product} of {self._robot} yet ({self._source} of the profile); "
                f"store one, as by cdff dpm put FILE --robot {self._robot} --type {self._product}; it is taken when it "
                "comes"
            ) from error

    def _hand_on(self, reply: Reply) -> None:
        header = Header.from_dict(reply.attachment)
        self.waits = ""
        if self._closed or header.id == self._id:
            return
        self._id, self._read = header.id, self._read + 1
        numbered = replace(header, seq=self._read)
        logger.info("%s: read %s of %s from the DPM", self._port, self._product, self._robot)
        self._take(Message(self._source, reply.payload, reply.encoding, numbered.to_attachment()))

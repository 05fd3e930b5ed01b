# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products on the bus that become messages of the robot: limits and counters."""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from typing import Any

from cdff_common.bus import Message
from cdff_common.clock import monotonic_s
from cdff_common.codecs import decode_payload
from cdff_common.errors import CdffError
from cdff_common.interfaces.product import Header, Status
from services.gateways.counters import RateLimit, TopicCounters
from services.gateways.stream_settings import OutputStream

logger = logging.getLogger(__name__)


class ProductLink(ABC):
    """A product and the messages that it becomes.

    Parameters
    ----------
    entry : OutputStream
    """

    def __init__(self, entry: OutputStream) -> None:
        self.product, self.counters = entry.product, TopicCounters()
        self._rate, self._max_hz = RateLimit(entry.max_hz), entry.max_hz

    def on_message(self, message: Message) -> None:
        """Convert a product and send it to the robot; a faulty product is counted and dropped."""
        start_s = monotonic_s()
        self.counters.receive(len(message.payload))
        if not self._rate.admits(start_s):
            self.drop("rate", f"more than {self._max_hz:g} messages per second")
            return
        try:
            header = Header.from_attachment(message.attachment)
            if header.quality.status is Status.FAILED:
                self.drop("failed", f"its producer reports FAILED: {', '.join(header.quality.reasons)}")
                return
            self.send(decode_payload(message.payload, message.encoding), header)
        except CdffError as error:
            self.drop("content", f"{type(error).__name__}: {error}")
            return
        self.counters.forward(monotonic_s() - start_s)

    @abstractmethod
    def send(self, value: Any, header: Header) -> None:
        """Send a value to the robot; raises CdffError if that is not possible."""

    def drop(self, reason: str, detail: str) -> None:
        """Count a product that is not sent, and log the first with a reason."""
        if self.counters.drop(reason, detail):
            logger.warning("%s: dropped (%s): %s", self.product, reason, detail)

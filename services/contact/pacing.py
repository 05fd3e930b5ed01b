# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pacing of packets below the rate of a link, so that no queue grows in the radio and delays commands."""

from __future__ import annotations

from services.contact.packets import FRAME_BYTES

#: Share of the rate that is used: the rest is for the keep-alive messages of Zenoh.
_SHARE = 0.97
#: Time whose bytes may be sent at once, seconds, after the thread was not scheduled.
_BURST_S = 0.1


class Pacer:
    """Limits the bytes that are sent to the rate of the link."""

    def __init__(self) -> None:
        self._rate, self._credit, self._last_s = 0.0, 0.0, 0.0

    def set_rate(self, rate_bit_s: float) -> None:
        """Set the rate of the link, bit/s."""
        self._rate = _SHARE * rate_bit_s / 8.0

    def update(self, now_s: float) -> None:
        """Add the bytes that the link transmits in the time since the last call."""
        elapsed_s, self._last_s = now_s - self._last_s, now_s
        self._credit = min(self._credit + self._rate * elapsed_s, self._rate * _BURST_S)

    @property
    def is_free(self) -> bool:
        """True if a packet may be sent now."""
        return self._credit > 0.0

    def spend(self, packet: bytes) -> None:
        """Subtract the bytes of a sent packet; after an urgent packet without credit the next ones wait."""
        self._credit -= len(packet) + FRAME_BYTES

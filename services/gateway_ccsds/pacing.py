# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pacing of bytes at the rate of a link."""

from __future__ import annotations

from cdff_common.clock import monotonic_s

#: Duration of a burst, seconds.
_BURST_S = 0.02


class Pacing:
    """Token bucket of bytes.

    Parameters
    ----------
    rate_bit_s : float
    largest_bytes : int
        Largest packet.
    """

    def __init__(self, rate_bit_s: float, largest_bytes: int) -> None:
        self._rate_byte_s = rate_bit_s / 8.0
        self._capacity = max(2.0 * largest_bytes, _BURST_S * self._rate_byte_s)
        self._credit, self._since_s = self._capacity, monotonic_s()

    @property
    def is_open(self) -> bool:
        """True if a packet may be sent now."""
        now_s = monotonic_s()
        self._credit = min(self._credit + (now_s - self._since_s) * self._rate_byte_s, self._capacity)
        self._since_s = now_s
        return self._credit > 0.0

    def take(self, size: int) -> None:
        """Count the bytes of a packet."""
        self._credit -= size

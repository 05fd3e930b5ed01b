# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Estimate of the times at which the products of a robot will be at the ground."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from cdff_common.interfaces.contact_plan import ContactWindow
from services.contact.packets import CHUNK_BYTES, FRAME_BYTES

#: Bytes of a packet in addition to those of the item: array, key, offset, sequence number.
_PACKET_BYTES = 40
#: Share of the rate that the pacing leaves for packets, and share of the packets that are not repeated.
_PACED, _NOT_REPEATED = 0.97, 0.97
#: Share of the rate at which item bytes arrive.
USED_SHARE = _PACED * _NOT_REPEATED * CHUNK_BYTES / (CHUNK_BYTES + FRAME_BYTES + _PACKET_BYTES)


class Waiting(NamedTuple):
    """A product, or several with one name, that is not at the ground.

    Attributes
    ----------
    name : str
        Id of the product, or a text for several.
    priority : int
    size, missing : int
        Bytes of the payload, and those that are not at the ground.
    """

    name: str
    priority: int
    size: int
    missing: int


class Arrival(NamedTuple):
    """Expected arrival of a product.

    Attributes
    ----------
    arrives_ns : int or None
        Mission time; None if the windows of the plan do not suffice.
    """

    waiting: Waiting
    arrives_ns: int | None


def estimate(
    waiting: Iterable[Waiting],
    windows: Sequence[ContactWindow],
    now_ns: int,
    budget_bit_s: float | None = None,
) -> list[Arrival]:
    """Return when each product arrives, if they are sent in their order from now on.

    Parameters
    ----------
    waiting : iterable of Waiting
        In the order in which the robot sends them.
    windows : sequence of ContactWindow
        Those that have not ended, in order.
    budget_bit_s : float, optional
        Largest rate, bit/s.
    """
    arrivals, index, start_ns = [], 0, float(now_ns)
    for item in waiting:
        missing = float(item.missing)
        arrives_ns: int | None = None
        while index < len(windows):
            window = windows[index]
            start_ns = max(start_ns, window.start_ns)
            bytes_s = USED_SHARE * min(window.rate_bit_s, budget_bit_s or window.rate_bit_s) / 8.0
            needed_ns = missing / bytes_s * 1e9
            if start_ns + needed_ns <= window.end_ns:
                start_ns += needed_ns
                arrives_ns = int(start_ns + window.delay_s * 1e9) // 1000 * 1000
                break
            missing -= max(window.end_ns - start_ns, 0.0) / 1e9 * bytes_s
            index += 1
        arrivals.append(Arrival(item, arrives_ns))
    return arrivals

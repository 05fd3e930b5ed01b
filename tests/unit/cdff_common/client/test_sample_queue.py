# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A busy link drops the oldest waiting samples; the driver never waits for it."""

from __future__ import annotations

import threading

from cdff_common.client.sample_queue import EncodedSample, SampleQueue
from cdff_common.errors import UnavailableError


def sample(number: int) -> EncodedSample:
    return EncodedSample(bytes([number]), "", b"")


def test_a_busy_link_drops_the_oldest_waiting_samples_and_counts_them() -> None:
    is_free, is_busy = threading.Event(), threading.Event()
    received: list[int] = []

    def send(item: EncodedSample) -> None:
        is_busy.set()
        assert is_free.wait(10)
        received.append(item.payload[0])

    queue = SampleQueue("mana/imu/sample", 3, send)
    queue.put(sample(0))
    assert is_busy.wait(10)
    for number in range(1, 8):
        queue.put(sample(number))
    assert queue.dropped == 4
    assert not queue.flush(0.0)
    is_free.set()
    assert queue.flush(10)
    assert received == [0, 5, 6, 7]
    assert (queue.sent, queue.dropped) == (4, 4)
    queue.close(1.0)


def test_a_closed_connection_counts_samples_as_dropped_and_the_queue_closes() -> None:
    def send(item: EncodedSample) -> None:
        raise UnavailableError("closed")

    queue = SampleQueue("mana/imu/sample", 3, send)
    queue.put(sample(0))
    queue.close(5.0)
    assert (queue.sent, queue.dropped) == (0, 1)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bytes that are sent at the start of a session, before the ground reports its intervals."""

from __future__ import annotations

import pytest

from services.contact.packets import CHUNK_BYTES, unpack
from services.contact.sender import Sender

KEY, CHUNKS = 1, 5
TOTAL = CHUNKS * CHUNK_BYTES


@pytest.fixture
def sender() -> Sender:
    """A sender with one item of five packets."""
    sender = Sender(lambda key, offset, length: b"x" * length, lambda key: TOTAL, lambda key: None)
    sender.add(KEY, 2)
    return sender


def sent(sender: Sender, count: int = 100) -> list[int]:
    """Return the numbers of the chunks of the next packets."""
    packets = [packet for _ in range(count) if (packet := sender.next_packet(0.0)) is not None]
    return [unpack(packet)[1][4] // CHUNK_BYTES for packet in packets]


def interval(first: int, end: int) -> list[tuple[int, int, list[tuple[int, int]]]]:
    """Return a report of the ground that has chunks of the item."""
    return [(KEY, TOTAL, [(first * CHUNK_BYTES, end * CHUNK_BYTES)])]


def test_packets_sent_before_the_report_of_the_ground_are_not_sent_again(sender: Sender) -> None:
    sender.begin(1)
    assert sent(sender, 2) == [0, 1]
    sender.resume([])
    assert sent(sender) == [2, 3, 4]


def test_in_a_new_session_only_the_bytes_that_the_ground_lacks_are_sent_again(sender: Sender) -> None:
    sender.begin(1)
    sender.resume([])
    assert sent(sender, 4) == [0, 1, 2, 3]
    sender.begin(2)
    assert sent(sender) == [4]
    sender.resume(interval(0, 2))
    assert sent(sender) == [2, 3]


def test_a_later_process_starts_after_the_noted_bytes_and_sends_the_others_after_the_report(
    sender: Sender,
) -> None:
    sender.expect({KEY: 3 * CHUNK_BYTES})
    sender.begin(1)
    assert sent(sender) == [3, 4]
    sender.resume(interval(0, 2))
    assert sent(sender) == [2]


def test_an_item_of_which_the_ground_has_all_bytes_is_reported_after_one_packet(sender: Sender) -> None:
    sender.expect({KEY: 10 * TOTAL})
    sender.begin(1)
    sender.resume(interval(0, CHUNKS))
    assert sent(sender) == [0]


def test_progress_is_the_end_of_the_sent_bytes_of_an_item(sender: Sender) -> None:
    sender.begin(1)
    assert sender.progress() == {}
    sent(sender, 2)
    assert sender.progress() == {KEY: 2 * CHUNK_BYTES}
    sender.remove(KEY)
    assert sender.progress() == {}


def test_the_oldest_packet_without_an_acknowledgement_is_known(sender: Sender) -> None:
    sender.begin(1)
    assert sender.oldest_s == float("inf")
    for now_s in (1.0, 2.0, 3.0):
        sender.next_packet(now_s)
    sender.acknowledge(1, 2, [])
    assert sender.oldest_s == 3.0

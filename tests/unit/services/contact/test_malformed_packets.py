# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Packets and requests that are not readable change nothing and do not end the exchange."""

from __future__ import annotations

import time
from typing import cast

import pytest

from cdff_common.bus import Bus, keys
from cdff_common.bus.contact_session import ContactSession
from cdff_common.errors import CodecError, InputError
from cdff_common.interfaces.contact_plan import ContactPlan
from cdff_dev.contact.generated_products import product
from services.contact.packets import Kind, pack
from services.contact.sender import Sender
from services.contact.service import execute_on_bus
from tests.unit.services.contact.test_exchange import POSES, Ends, ends, is_at_ground, wait_until, window

__all__ = ["ends"]
_PACKETS = (
    b"",
    b"\xc1" * 50,
    b"\x93",
    pack(Kind.HELLO),
    pack(Kind.HELLO, 7, 8, 9),
    pack(Kind.DATA, 7, 1),
    pack(Kind.DATA, 7, 2**60, 3, 10, 0, b"x" * 10),
    pack(Kind.DATA, 7, 1, -3, 10, 0, b"x" * 10),
    pack(Kind.DATA, 7, 1, 3, 1 << 40, 0, b"x"),
    pack(Kind.DATA, 7, 1, 3, 1, 0, b"x"),
    pack(Kind.RESULT, 5),
    pack(Kind.TAKEN, ["x"]),
    pack(Kind.ACK, 7, 0, 2**60, [[0, 2**60]], [], []),
)


def test_the_ground_stores_products_after_malformed_packets(ends: Ends) -> None:
    ends.robot.store.put_all([product(1, n) for n in POSES])
    plan = ContactPlan(windows=(window(0, 100),))
    with ends.start_ground(plan) as ground:
        with ContactSession.connect(ends.ground_address) as stranger:
            for packet in _PACKETS:
                stranger.send(keys.contact("mana", "down"), packet)
                stranger.send(keys.contact("nobody", "down"), packet)
            time.sleep(0.5)
        assert ground.estimate("mana")["others"] == []
        with ends.start_robot(plan):
            wait_until(lambda: is_at_ground(ends, *POSES))


def test_a_packet_number_far_ahead_is_refused(ends: Ends) -> None:
    plan = ContactPlan(windows=(window(0, 100),))
    with ends.start_ground(plan) as ground:
        receiver = ground._robots["mana"].receiver
        receiver.welcome(7, "store")
        with pytest.raises(CodecError, match="the last number is 0"):
            receiver.receive([7, 2**60, 3, 2000, 0, b"x" * 10])
        assert receiver.acknowledgement() is None


def test_an_acknowledgement_of_numbers_that_were_not_sent_has_no_effect() -> None:
    sender = Sender(lambda key, offset, length: b"x" * length, lambda key: 10, lambda key: None)
    sender.add(3, 1)
    sender.begin(7)
    sender.resume([])
    assert sender.next_packet(0.0) is not None
    sender.acknowledge(0, 2**60, [(0, 2**60)])
    assert sender.next_packet(0.0) is not None  # the packet counts as lost and is sent again


def test_an_estimate_for_a_robot_without_windows_names_the_others(ends: Ends) -> None:
    plan = ContactPlan(windows=(window(0, 100),))
    with ends.start_ground(plan) as ground, pytest.raises(InputError, match="windows of mana"):
        ground.estimate("minnie")


def test_a_request_that_the_orchestrator_would_refuse_is_answered_with_the_reason() -> None:
    bus = cast("Bus", None)  # not called
    answer = execute_on_bus(bus, "mana", {"type": "dem", "deadline_ms": "soon"}, 60.0)
    assert "deadline_ms" in answer["error"]

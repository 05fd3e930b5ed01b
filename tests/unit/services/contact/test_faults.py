# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Faults of the end of the ground: full disk, unreadable items, lost records, clocks and missed windows."""

from __future__ import annotations

import errno
import os
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from cdff_common.clock import Clock
from cdff_common.errors import InputError
from cdff_common.interfaces.contact_plan import ContactPlan
from cdff_dev.contact.generated_products import product
from services.alarms import Alarms
from services.contact.conditions import CLOCK_LIMIT_S, ExchangeAlarms
from services.contact.packets import CHUNK_BYTES, Item, Kind, pack_record, unpack
from services.contact.receiver import Receiver
from tests.unit.services.contact.test_exchange import CLOUD, Ends, ends, window

__all__ = ["ends"]
EPOCH, TOTAL = 7, 3 * CHUNK_BYTES


class FixedClock(Clock):
    """A clock that the test sets."""

    def __init__(self, now_ns: int) -> None:
        self.time_ns = now_ns

    def now_ns(self) -> int:
        """Return the set time."""
        return self.time_ns


def a_receiver(ends: Ends) -> Receiver:
    """Return the receiver of an end of the ground that has ended."""
    plan = ContactPlan(windows=(window(1000.0, 1100.0),))
    ground = ends.start_ground(plan).thing
    ground._ended.set()
    for thread in ground._threads:
        thread.join()
    ground._session.close()  # its threads would keep the process of the tests alive
    receiver: Receiver = ground._robots["mana"].receiver
    receiver.welcome(EPOCH, "store")
    return receiver


def acknowledgement(receiver: Receiver) -> list[object]:
    """Return the fields of an acknowledgement: epoch, low, high, missing, done, wanted."""
    packet = receiver.acknowledgement()
    assert packet is not None
    kind, fields = unpack(packet)
    assert kind is Kind.ACK
    return fields


def test_a_packet_that_cannot_be_written_is_not_acknowledged(
    ends: Ends, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    receiver, key = a_receiver(ends), Item.PAYLOAD.key(1)
    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", full)
        with pytest.raises(OSError, match="No space"):
            receiver.receive([EPOCH, 1, key, TOTAL, 0, b"x" * CHUNK_BYTES])
    receiver.receive([EPOCH, 2, key, TOTAL, CHUNK_BYTES, b"x" * CHUNK_BYTES])
    assert acknowledgement(receiver)[2:4] == [2, [[1, 2]]]


def test_an_item_that_is_not_readable_is_received_again(ends: Ends) -> None:
    receiver, key = a_receiver(ends), Item.EVENTS.key(1)
    receiver.receive([EPOCH, 1, key, 2 * CHUNK_BYTES, 0, b"x" * CHUNK_BYTES])
    receiver.receive([EPOCH, 2, key, 2 * CHUNK_BYTES, CHUNK_BYTES, b"x" * CHUNK_BYTES])
    assert receiver.missing_bytes(key, 2 * CHUNK_BYTES) == 2 * CHUNK_BYTES


def test_the_ground_asks_for_the_record_of_a_payload_that_it_does_not_have(ends: Ends) -> None:
    receiver, key = a_receiver(ends), Item.PAYLOAD.key(1)
    receiver.receive([EPOCH, 1, key, TOTAL, 0, b"x" * CHUNK_BYTES])
    assert acknowledgement(receiver)[5] == [[Item.RECORD.key(1), [[0, 1]]]]


def test_the_robot_sends_a_record_again_that_the_ground_asks_for(ends: Ends) -> None:
    ends.robot.store.put_all([product(1, CLOUD)])
    plan = ContactPlan(windows=(window(1000.0, 1100.0),))
    with ends.start_robot(plan) as robot:
        robot.outgoing.scan()
        (ordinal,) = robot.outgoing._products
        key = Item.RECORD.key(ordinal)
        robot.outgoing.done([key])
        assert key not in robot.outgoing.sender
        robot.outgoing.want(key, [(0, 1)])
        assert key in robot.outgoing.sender


def test_a_product_that_the_ground_already_has_is_reported_when_its_record_comes(ends: Ends) -> None:
    cloud = product(1, CLOUD)
    for side in (ends.robot, ends.ground):
        side.store.put_all([cloud])
    receiver = a_receiver(ends)
    data = pack_record(ends.robot.store.get(cloud.header.id), 2, None)
    receiver.receive([EPOCH, 1, Item.RECORD.key(1), len(data), 0, data])
    receiver.flush()
    assert acknowledgement(receiver)[4] == [Item.RECORD.key(1), Item.PAYLOAD.key(1)]


def test_a_product_that_the_store_refuses_raises_an_alarm_and_does_not_stop_the_others(
    ends: Ends, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused, stored = product(1, 0), product(1, 1)
    ends.robot.store.put_all([refused, stored])
    receiver, put_all = a_receiver(ends), ends.ground.writer.put_all

    def put_some(batch: Any) -> Any:
        if any(payload == refused.payload for _, payload, *_ in batch):
            raise InputError("this product is refused")
        return put_all(batch)

    monkeypatch.setattr(ends.ground.writer, "put_all", put_some)
    for number, made in enumerate((refused, stored), 1):
        data = pack_record(ends.robot.store.get(made.header.id), 0, made.payload)
        receiver.receive([EPOCH, number, Item.RECORD.key(number), len(data), 0, data])
    receiver.flush()
    assert ends.ground.store.live([refused.header.id, stored.header.id]) == {stored.header.id}
    assert [alarm.kind for alarm in ends.ground.alarms.active()] == ["contact_refused"]


def test_a_clock_that_differs_raises_an_alarm_with_the_difference() -> None:
    plan, alarms = ContactPlan(windows=(window(0.0, 100.0),)), Alarms()
    conditions = ExchangeAlarms(alarms, plan, FixedClock(plan.windows[0].start_ns))
    conditions.compare_clock("mana", plan.windows[0].start_ns + 3_600_000_000_000, 0.0)
    (alarm,) = alarms.active()
    assert alarm.kind == "contact_clock"
    assert "+3600 s" in alarm.what
    conditions.compare_clock("mana", plan.windows[0].start_ns + int(CLOCK_LIMIT_S * 0.9e9), 0.0)
    assert not alarms.active()


def test_a_window_without_contact_raises_an_alarm_unless_the_ground_started_in_it() -> None:
    now = datetime.now(UTC)
    plan, alarms = ContactPlan(windows=(window(0.0, 100.0), window(200.0, 300.0))), Alarms()
    assert plan.windows[0].start - now < timedelta(seconds=1.0)
    first, second = plan.windows
    clock = FixedClock(first.start_ns + 1)
    conditions = ExchangeAlarms(alarms, plan, clock)
    clock.time_ns = first.end_ns
    conditions.check_windows("mana", None)
    assert not alarms.active()
    clock.time_ns = second.end_ns
    conditions.check_windows("mana", first.end_ns)
    assert [alarm.kind for alarm in alarms.active()] == ["contact_missed"]
    conditions.check_windows("mana", second.start_ns + 1)
    assert not alarms.active()

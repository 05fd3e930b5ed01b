# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from spacepackets.ecss.tc import PusTc
from spacepackets.ecss.tm import PusTm

from cdff_common.errors import CodecError, ConfigurationError, DeniedError, UnavailableError
from cdff_common.loops import Loops
from services.gateway_ccsds.authentication import Command, CommandCounter, CommandKey, Function
from services.gateway_ccsds.commands import CommandReceiver
from services.gateway_ccsds.telemetry import Telemetry

KEY = CommandKey(bytes(range(32)))
SEND = Command(Function.SEND, 5, {"id": "x"})


def test_a_command_is_opened_with_the_key_and_robot_it_was_written_for_only() -> None:
    data = KEY.seal("mana", SEND)
    assert KEY.open("mana", data) == SEND
    with pytest.raises(DeniedError):
        KEY.open("minnie", data)
    with pytest.raises(DeniedError):
        CommandKey(bytes(32)).open("mana", data)


@pytest.mark.parametrize("position", [0, 8, 12, -1])
def test_a_changed_byte_is_denied(position: int) -> None:
    data = bytearray(KEY.seal("mana", SEND))
    data[position] ^= 1
    with pytest.raises(DeniedError):
        KEY.open("mana", bytes(data))


@pytest.mark.parametrize("arguments", [b"", b"x", b"[]", b"\xff", 1500 * b"[", b'{"a": ' * 600])
def test_a_command_without_an_object_as_arguments_is_malformed(arguments: bytes) -> None:
    data = b"\1" + bytes(8) + arguments
    with pytest.raises(CodecError):
        KEY.open("mana", data + KEY._code("mana", data))


@pytest.mark.parametrize("data", [b"", bytes(24), bytes(5000)])
def test_a_command_of_an_impossible_size_is_malformed(data: bytes) -> None:
    with pytest.raises(CodecError):
        KEY.open("mana", data)


def test_a_key_file_is_private_and_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "key"
    CommandKey.write(path)
    assert CommandKey.read(path).open("mana", CommandKey.read(path).seal("mana", SEND)) == SEND
    with pytest.raises(ConfigurationError, match="remove the old key"):
        CommandKey.write(path)
    path.chmod(0o640)
    with pytest.raises(ConfigurationError, match="chmod 600"):
        CommandKey.read(path)


def test_a_counter_is_taken_once_also_after_a_restart(tmp_path: Path) -> None:
    CommandCounter(tmp_path / "counter").take(7)
    counter = CommandCounter(tmp_path / "counter")
    for old in (0, 6, 7):
        with pytest.raises(DeniedError):
            counter.take(old)
    counter.take(8)


class Station:
    """A receiver of commands and the reports that it sends."""

    def __init__(self, folder: Path) -> None:
        self.sent: list[bytes] = []
        self.executed: list[Command] = []
        telemetry = Telemetry(77, self.sent.append, lambda: 10**9)
        telemetry.set_contact(True)
        self.loop, cancel_loop = Loops().add("commands"), Loops().add("cancellations")
        counter = CommandCounter(folder / "counter")
        self.cancelled = threading.Event()
        self.receiver = CommandReceiver(
            "mana", 77, KEY, counter, telemetry, self.execute, self.loop, cancel_loop
        )

    def execute(self, command: Command, report: Callable[[str], None]) -> str:
        match command.arguments:
            case {"fail": "unavailable"}:
                raise UnavailableError("no orchestrator")
            case {"fail": "disk"}:
                raise OSError(28, "No space left on device")
            case {"fail": "defect"}:
                raise TypeError("a defect")
        if command.function is Function.REQUEST:
            report("job 1: running")
            assert self.cancelled.wait(10.0)
        if command.function is Function.CANCEL:
            self.cancelled.set()
        self.executed.append(command)
        return "done"

    def send(self, body: bytes, *, apid: int = 77, service: int = 8) -> None:
        tc = PusTc(service=service, message_subtype=1, apid=apid, app_data=body, seq_count=3)
        self.receiver.on_packet(bytes(tc.pack()))

    def reports(self, count: int) -> list[tuple[int, int]]:
        deadline_s = time.monotonic() + 10.0
        while len(self.sent) < count and time.monotonic() < deadline_s:
            time.sleep(0.005)
        packets = [PusTm.unpack(data, timestamp_len=8) for data in self.sent]
        return [(packet.service, packet.message_subtype) for packet in packets]


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Station]:
    station = Station(tmp_path)
    yield station
    station.receiver.close()


def test_a_command_is_verified_at_each_stage_and_executed_once(station: Station) -> None:
    body = KEY.seal("mana", SEND)
    station.send(body)
    assert station.reports(4) == [(1, 1), (1, 3), (1, 7), (5, 1)]
    station.send(body)
    assert station.reports(5)[4] == (1, 2)
    assert station.executed == [SEND]
    assert station.receiver.counters == {"accepted": 1, "executed": 1, "refused": 1}


@pytest.mark.parametrize(
    ("reason", "text"),
    [
        ("unavailable", b"UnavailableError: no orchestrator"),
        ("disk", b"OSError: [Errno 28] No space left on device"),
        ("defect", b"TypeError: a defect"),
    ],
)
@pytest.mark.parametrize("function", Function)
def test_each_failed_execution_is_reported_with_its_reason_and_the_next_command_is_executed(
    station: Station, function: Function, reason: str, text: bytes
) -> None:
    station.send(KEY.seal("mana", Command(function, 1, {"fail": reason})))
    assert station.reports(4) == [(1, 1), (1, 3), (1, 8), (5, 2)]
    failure = PusTm.unpack(station.sent[2], timestamp_len=8)
    assert failure.source_data[4:6] == b"\0\4"
    assert failure.source_data[7:] == text
    station.cancelled.set()
    station.send(KEY.seal("mana", Command(function, 2, {})))
    assert (1, 7) in station.reports(8)
    assert station.receiver.counters == {"accepted": 2, "failed": 1, "executed": 1}


def test_a_cancellation_is_executed_while_a_request_is(station: Station) -> None:
    request, cancel = Command(Function.REQUEST, 1, {"type": "dem"}), Command(Function.CANCEL, 2, {"job": "1"})
    station.send(KEY.seal("mana", request))
    assert station.reports(3) == [(1, 1), (1, 3), (5, 1)]
    progress = PusTm.unpack(station.sent[2], timestamp_len=8)
    assert progress.source_data == b"\x10command_progress\x07request\x0ejob 1: running"
    station.send(KEY.seal("mana", cancel))
    station.reports(9)
    assert sorted(station.executed, key=lambda command: command.counter) == [request, cancel]


def test_at_the_end_waiting_commands_are_not_executed(tmp_path: Path) -> None:
    station = Station(tmp_path)
    for counter in range(17):
        station.send(KEY.seal("mana", Command(Function.REQUEST, counter, {"type": "dem"})))
        station.reports(1)
        deadline_s = time.monotonic() + 10.0
        while counter == 0 and len(station.sent) < 3 and time.monotonic() < deadline_s:
            time.sleep(0.005)
    station.send(KEY.seal("mana", Command(Function.REQUEST, 17, {"type": "dem"})))
    assert station.receiver.counters == {"accepted": 17, "refused": 1}
    threading.Timer(0.1, station.cancelled.set).start()
    station.receiver.close()
    assert [command.counter for command in station.executed] == [0]


def test_packets_of_others_and_damaged_ones_are_dropped_and_other_services_refused(station: Station) -> None:
    body = KEY.seal("mana", SEND)
    station.send(body, apid=78)
    station.receiver.on_packet(b"\x18\x4d")
    packed = bytearray(PusTc(service=8, message_subtype=1, apid=77, app_data=body).pack())
    packed[-1] ^= 1
    station.receiver.on_packet(bytes(packed))
    assert station.receiver.counters == {"malformed": 3}
    station.send(body, service=17)
    assert station.reports(1) == [(1, 2)]
    assert station.executed == []


def test_a_command_file_is_reported_by_events(station: Station) -> None:
    station.receiver.on_file("a", KEY.seal("mana", SEND))
    station.receiver.on_file("b", b"no command, but long enough")
    assert sorted(station.reports(2)) == [(5, 1), (5, 2)]
    assert station.executed == [SEND]

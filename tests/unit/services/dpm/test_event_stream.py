# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Server-sent events over a real socket: order, resumption without gaps, keep-alive, slow readers."""

from __future__ import annotations

import http.client
import json
import logging
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from services.dpm.http.context import Context
from services.dpm.http.routes import status
from services.dpm.http.server import HttpServer
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings

from .conftest import cloud, put_arguments


@pytest.fixture
def port(dpm: Dpm, tmp_path: Path) -> Iterator[int]:
    """The port of a server that runs during the test."""
    with HttpServer(Context(dpm, Settings(tmp_path, port=0))) as server:
        yield server.port


class Reader:
    """A client of the event stream; ``last`` is the id of the last event that it has received."""

    def __init__(self, port: int, last: int | None = None) -> None:
        self.connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
        headers = {} if last is None else {"Last-Event-ID": str(last)}
        self.connection.request("GET", "/api/v1/events", headers=headers)
        self.answer = self.connection.getresponse()
        assert self.answer.getheader("Content-Type", "").startswith("text/event-stream")
        assert self.block() == [": connected"]

    def block(self) -> list[str]:
        """Return the lines up to the next empty one."""
        lines = []
        while (line := self.answer.readline().decode().rstrip("\n")) != "":
            lines.append(line)
        return lines

    def event(self) -> tuple[int, str, dict[str, object]]:
        """Return id, kind and body of the next event; skip keep-alive messages."""
        while (lines := self.block())[0].startswith(":"):
            pass
        fields = dict(line.split(": ", 1) for line in lines)
        return int(fields["id"]), fields["event"], json.loads(fields["data"])

    def close(self) -> None:
        self.connection.close()


def test_events_are_streamed_in_order(dpm: Dpm, port: int) -> None:
    reader = Reader(port)
    for i in range(3):
        dpm.writer.record("mana", "alarm", {"number": i})
    received = [reader.event() for _ in range(3)]
    assert [body["number"] for _, _, body in received] == [0, 1, 2]
    assert {kind for _, kind, _ in received} == {"alarm"}
    _, header = dpm.writer.put(*put_arguments(cloud(), "pointcloud"))
    _, kind, body = reader.event()
    assert (kind, body["id"]) == ("inserted", header.id)
    reader.close()


def test_a_field_of_an_event_with_the_name_of_an_attribute_is_not_lost(dpm: Dpm, port: int) -> None:
    reader = Reader(port)
    dpm.frames.define_body({"name": "bennu", "kind": "asteroid", "radii_m": [252.8, 246.0, 228.7]}, "test")
    number, kind, body = reader.event()
    assert (kind, body["kind"], body["body_kind"]) == ("body_defined", "body_defined", "asteroid")
    (listed,) = dpm.reports.history(number - 1, 10)["items"]
    assert (listed["ordinal"], listed["kind"], listed["body_kind"]) == (number, "body_defined", "asteroid")
    dpm.writer.record("mana", "alarm", {"scope": "lidar", "stamp_ns": 7, "kind": "alarm"})
    _, _, body = reader.event()
    assert (body["scope"], body["body_scope"], body["body_stamp_ns"]) == ("mana", "lidar", "7")
    assert "body_kind" not in body
    reader.close()


@pytest.mark.req("CDFF-SUP-164")
def test_a_reconnected_reader_receives_each_event_exactly_once(dpm: Dpm, port: int) -> None:
    reader = Reader(port, 0)
    for i in range(5):
        dpm.writer.record("mana", "alarm", {"number": i})
    last, _, _ = [reader.event() for _ in range(2)][-1]
    reader.close()
    for i in range(5, 100):  # more events than one read returns
        dpm.store.events.append("mana", "alarm", {"number": i})
    reader = Reader(port, last)
    assert [reader.event()[2]["number"] for _ in range(98)] == list(range(2, 100))
    dpm.writer.record("mana", "alarm", {"number": 100})
    assert reader.event()[2]["number"] == 100
    reader.close()


def test_an_idle_stream_sends_keep_alive_messages(
    dpm: Dpm, port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(status, "_KEEP_ALIVE_S", 0.05)
    reader = Reader(port)
    assert [reader.block() for _ in range(2)] == [[": still here"]] * 2
    reader.close()


@pytest.mark.slow
@pytest.mark.req("CDFF-SUP-164")
def test_a_slow_reader_does_not_block_others_and_uses_bounded_memory(dpm: Dpm, port: int) -> None:
    slow = socket.create_connection(("127.0.0.1", port), timeout=20)
    slow.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    slow.sendall(b"GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\nLast-Event-ID: 0\r\n\r\n")
    process = psutil.Process()
    for _ in range(150):
        dpm.writer.record("mana", "alarm", {"text": "x" * 60_000})
    resident_bytes = process.memory_info().rss
    for _ in range(500):
        dpm.writer.record("mana", "alarm", {"text": "x" * 60_000})
    dpm.writer.record("mana", "alarm", {"number": 1})
    quick = Reader(port, dpm.store.events.last_ordinal() - 1)
    assert quick.event()[2]["number"] == 1
    assert (
        process.memory_info().rss - resident_bytes < 16 << 20
    )  # the 30 MB of events that the slow reader did not receive are not kept in memory
    slow.close()
    quick.close()
    wait_until_removed(dpm)


def test_a_disconnected_reader_is_removed(dpm: Dpm, port: int) -> None:
    reader = Reader(port)
    assert len(dpm.events._listeners) == 1
    reader.close()
    wait_until_removed(dpm)


def test_a_server_that_stops_ends_its_streams(
    dpm: Dpm, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with HttpServer(Context(dpm, Settings(tmp_path, port=0))) as server:
        reader = Reader(server.port)
    assert reader.answer.read() == b""
    reader.close()
    assert not [r for r in caplog.records if r.levelno >= logging.ERROR]


def wait_until_removed(dpm: Dpm) -> None:
    """Wait until the DPM has no listener."""
    deadline_s = time.monotonic() + 20.0
    while dpm.events._listeners:
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


@pytest.mark.parametrize("last", ["-1", "abc", "²", "9" * 40])
def test_an_invalid_last_event_id_is_refused(port: int, last: str) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    connection.request("GET", "/api/v1/events", headers={"Last-Event-ID": last.encode("latin-1")})  # type: ignore[dict-item]  # bytes
    answer = connection.getresponse()
    assert (answer.status, answer.getheader("Content-Type")) == (422, "application/problem+json")
    connection.close()

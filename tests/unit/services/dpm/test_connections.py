# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Silent, slow and broken connections to a real HTTP server."""

from __future__ import annotations

import hashlib
import logging
import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from services.dpm.http import connections
from services.dpm.http import server as http_server
from services.dpm.http.app import create_app
from services.dpm.http.context import Context
from services.dpm.http.middleware import admission, uploads
from services.dpm.http.middleware.roles import Keys
from services.dpm.http.server import HttpServer
from services.dpm.operations.dpm import Dpm
from services.dpm.settings import Settings

from .conftest import cloud, put_arguments

Connect = Callable[..., socket.socket]
HEAD = (
    b"POST /api/v1/products?robot=mana&dfpc=test&port=dem&product=dem HTTP/1.1\r\nHost: localhost\r\n"
    b"Content-Type: application/vnd.cdff+uper;ElevationMap/1\r\nCDFF-Header: {}\r\n"
    b"Content-Length: 1000000\r\n\r\n"
)


@pytest.fixture
def port(dpm: Dpm, tmp_path: Path) -> Iterator[int]:
    """The port of a server that runs during the test."""
    with HttpServer(Context(dpm, Settings(tmp_path, port=0, max_body_bytes=2 << 20))) as server:
        yield server.port


@pytest.fixture
def connect(port: int) -> Iterator[Connect]:
    """``connect(data) -> socket``: a connection that has sent some bytes, until the end of the test."""
    opened = []

    def connected(data: bytes = b"") -> socket.socket:
        opened.append(socket.create_connection(("127.0.0.1", port), timeout=20.0))
        opened[-1].sendall(data)
        return opened[-1]

    yield connected
    for connection in opened:
        connection.close()


def is_closed(connection: socket.socket) -> bool:
    """Return whether the server has closed a connection, waiting for it."""
    try:
        return connection.recv(1) == b""
    except ConnectionResetError:
        return True


def is_healthy(port: int) -> bool:
    """Return whether a call is answered."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/healthz", timeout=20.0) as answer:
        return bool(answer.read() == b"ok\n")


def test_silent_connections_do_not_keep_others_from_calling(port: int, connect: Connect) -> None:
    silent = [connect() for _ in range(connections.MAX_IDLE_OF_ADDRESS + 50)]
    assert is_healthy(port)
    assert is_closed(silent[0])


def test_a_header_that_arrives_too_slowly_ends_the_connection(
    port: int, connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "HEADER_S", 0.3)
    slow = connect(b"GET /healthz HTTP/1.1\r\n")
    for _ in range(3):
        time.sleep(0.05)
        slow.sendall(b"X-Slow: 1\r\n")
    assert is_closed(slow)
    assert is_healthy(port)


def test_a_body_that_pauses_is_answered_with_408(connect: Connect, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(uploads, "PAUSE_S", 0.2)
    assert connect(HEAD + bytes(100)).recv(100).startswith(b"HTTP/1.1 408")


def test_a_broken_upload_leaves_nothing_and_no_traceback(
    connect: Connect, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    before = sorted(tmp_path.iterdir())
    with caplog.at_level(logging.INFO):
        connect(HEAD + bytes(900_000)).close()
        deadline_s = time.monotonic() + 20.0
        while "broken off" not in caplog.text:
            assert time.monotonic() < deadline_s
            time.sleep(0.02)
    assert sorted(tmp_path.iterdir()) == before
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


def test_the_bodies_of_all_uploads_together_are_bounded(
    dpm: Dpm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(uploads, "BODIES", 0)
    app = create_app(Context(dpm, Settings(tmp_path, max_body_bytes=2 << 20)))
    client = TestClient(app, base_url="http://127.0.0.1:8080")
    answer = client.post("/api/v1/transactions", content=bytes(300_000))
    assert (answer.status_code, answer.json()["code"]) == (503, "OVERLOADED")
    assert client.post("/api/v1/transactions", content=b"[]").status_code < 500


def test_too_many_requests_of_an_address_are_refused(
    connect: Connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(admission, "MAX_REQUESTS_OF_ADDRESS", 1)
    stream = connect(b"GET /api/v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n")
    assert stream.recv(12) == b"HTTP/1.1 200"
    answer = connect(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n").recv(1000)
    assert answer.startswith(b"HTTP/1.1 503")
    assert b"retry-after" in answer.lower()


def test_a_large_payload_is_streamed_unchanged(dpm: Dpm, http: TestClient) -> None:
    dpm.writer.max_payload_bytes = 8 << 20
    value = cloud(60_000)
    arguments = put_arguments(value, "pointcloud")
    _, header = dpm.writer.put(*arguments)
    url = f"/api/v1/products/{header.id}/payload"
    assert len(arguments[1]) > 1 << 20
    assert http.get(url).content == arguments[1]
    part = http.get(url, headers={"Range": "bytes=5-1300000"})
    assert (part.status_code, part.content) == (206, arguments[1][5:1300001])
    converted = http.get(url, params={"format": "ber"})
    assert len(converted.content) == int(converted.headers["Content-Length"]) > 1 << 20


def test_a_removed_key_is_refused_without_a_restart(tmp_path: Path) -> None:
    path = tmp_path / "keys"
    first, second = (f"{hashlib.sha256(key).hexdigest()} operator {key.decode()}\n" for key in (b"a", b"b"))
    path.write_text(first + second)
    keys = Keys(path)
    assert keys.actor("Bearer a") is not None
    path.write_text(second)
    assert keys.actor("Bearer a") is None
    assert keys.actor("Bearer b") is not None
    path.write_text("malformed line\n")
    assert keys.actor("Bearer b") is not None  # an error in the log
    path.unlink()
    assert keys.actor("Bearer b") is None


def test_a_server_whose_threads_all_hang_is_a_problem_of_the_process(
    dpm: Dpm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(http_server, "_PROBE_S", 0.01)
    monkeypatch.setattr(http_server, "_HUNG_S", 0.5)
    release = threading.Event()
    monkeypatch.setattr(dpm.reports, "status", lambda: {"products": release.wait(20)})

    def read(url: str) -> None:
        try:
            urllib.request.urlopen(url, timeout=20).close()
        except urllib.error.HTTPError as error:  # the status is incomplete
            error.close()

    def becomes(hangs: bool) -> bool:
        until_s = time.monotonic() + 10.0
        while ("answers nothing" in server.problem()) is not hangs and time.monotonic() < until_s:
            time.sleep(0.05)
        return ("answers nothing" in server.problem()) is hangs

    with HttpServer(Context(dpm, Settings(tmp_path, port=0))) as server, ThreadPoolExecutor(50) as pool:
        address = f"http://127.0.0.1:{server.port}/api/v1"
        urllib.request.urlopen(f"{address}/robots", timeout=20).close()
        assert becomes(hangs=False)
        calls = [pool.submit(read, f"{address}/status") for _ in range(50)]
        assert becomes(hangs=True)
        release.set()
        wait(calls)
        assert becomes(hangs=False)


@pytest.mark.parametrize(
    "data",
    [
        b"GET /stac/search?ids=" + b"a" * (600 << 10) + b" HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"a" * (600 << 10) + b"\r\n\r\n",
        b"no HTTP at all\r\n\r\n",
    ],
)
def test_a_request_that_cannot_be_read_is_answered_with_a_problem_document(
    connect: Connect, data: bytes
) -> None:
    connection = connect(data)
    answer = b""
    while part := connection.recv(4096):
        answer += part
    head, _, body = answer.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 400")
    assert b"application/problem+json" in head
    assert b"65536 bytes" in body

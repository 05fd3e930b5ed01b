# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The link between autonomy framework and servicer: it relays, is cut and is restored."""

from __future__ import annotations

import socket
import socketserver
import threading
from collections.abc import Iterator

import pytest

from cdff_dev.missions.orbit.link import InterruptibleLink
from cdff_dev.ports import split_address


class _Echo(socketserver.BaseRequestHandler):
    def handle(self) -> None:
        while data := self.request.recv(4096):
            self.request.sendall(data)


@pytest.fixture
def router() -> Iterator[str]:
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), _Echo) as server:
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        yield f"tcp/127.0.0.1:{server.server_address[1]}"
        server.shutdown()


def answer(link: InterruptibleLink, data: bytes) -> bytes:
    """Return the answer over a new connection; empty if it is closed."""
    received = b""
    try:
        with socket.create_connection(split_address(link.endpoint, "link"), 5.0) as client:
            client.sendall(data)
            while len(received) < len(data):
                part = client.recv(1 << 16)
                if not part:
                    break
                received += part
    except OSError:
        return b""
    return received


def test_a_link_relays_until_it_is_cut_and_after_it_is_restored(router: str) -> None:
    data = bytes(range(256)) * 2000
    with InterruptibleLink(router) as link:
        assert answer(link, data) == data
        with socket.create_connection(split_address(link.endpoint, "link"), 5.0) as existing:
            existing.sendall(b"a")
            assert existing.recv(1) == b"a"
            link.cut()
            assert existing.recv(1) == b""  # closed by the outage
        assert answer(link, b"lost") == b""
        link.restore()
        assert answer(link, b"again") == b"again"

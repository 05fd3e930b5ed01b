# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The Foxglove server plays a log to a client that connects after the log was read."""

from __future__ import annotations

import json
import os
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from cdff_common.errors import InputError, UnavailableError
from cdff_dev.ports import free_port
from cdff_dev.view import drawings
from cdff_dev.view.drawings import Layer

S = 1_000_000_000
T = 1_700_000_000 * S


class Client:
    """Client of Foxglove's WebSocket protocol over a plain socket."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=20.0)
        self._file = self._socket.makefile("rb")
        self._socket.sendall(
            b"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n"
            b"Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
        )
        while self._file.readline() not in (b"\r\n", b""):
            pass

    def send(self, message: dict[str, Any]) -> None:
        self._send(1, json.dumps(message).encode())

    def receive(self) -> dict[str, Any] | tuple[int, int]:
        """Return the next message: JSON, or number of the subscription and time of a message with data."""
        while True:
            first, second = self._file.read(2)
            size = second & 127
            if size > 125:
                size = int.from_bytes(self._file.read(2 if size == 126 else 8), "big")
            data = self._file.read(size)
            if first & 15 == 1:
                message: dict[str, Any] = json.loads(data)
                return message
            if first & 15 == 2 and data[0] == 1:
                return struct.unpack("<IQ", data[1:13])

    def close(self) -> None:
        self._file.close()
        self._socket.close()

    def _send(self, opcode: int, data: bytes) -> None:
        mask = os.urandom(4)
        masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(data))
        assert len(data) < 126
        self._socket.sendall(bytes([0x80 | opcode, 0x80 | len(data)]) + mask + masked)


@contextmanager
def connected(port: int) -> Iterator[tuple[Client, int]]:
    """Connect and subscribe to all topics; the second value is the number of topics."""
    client = Client(port)
    try:
        channels: list[Any] = []
        while not channels:
            message = client.receive()
            if isinstance(message, dict) and message["op"] == "advertise":
                channels = message["channels"]
        for channel in channels:
            subscription = {"id": channel["id"], "channelId": channel["id"]}
            client.send({"op": "subscribe", "subscriptions": [subscription]})
        yield client, len(channels)
    finally:
        client.close()


def stamps(client: Client, count: int) -> list[int]:
    """Return the times of the next messages with data."""
    stamps_ns: list[int] = []
    while len(stamps_ns) < count:
        message = client.receive()
        if isinstance(message, tuple):
            stamps_ns.append(message[1])
    return stamps_ns


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """Three poses in two tenths of a second."""
    pytest.importorskip("foxglove")
    import numpy as np

    from cdff_dev.view.foxglove_scene import mcap_scene

    path = tmp_path / "scene.mcap"
    file = mcap_scene(path)
    for number in range(3):
        pose = drawings.Transform("site", "mana/base", np.eye(4))
        file.put(T + number * S // 10, Layer("/mana/vo/pose", "site", pose))
    file.close()
    return path


def test_a_client_that_connects_later_receives_the_whole_log(scene: Path) -> None:
    from cdff_dev.view.foxglove_playback import PlaybackServer

    port = free_port()
    server = PlaybackServer(scene, "127.0.0.1", port)
    try:
        with connected(port) as (client, topics):
            assert topics == 1
            assert stamps(client, 3) == [T, T + S // 10, T + S // 5]
        with pytest.raises(UnavailableError, match="choose another with --port"):
            PlaybackServer(scene, "127.0.0.1", port)
    finally:
        server.close()


def test_a_file_without_messages_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    from cdff_dev.view.foxglove_playback import PlaybackServer
    from cdff_dev.view.foxglove_scene import mcap_scene

    mcap_scene(tmp_path / "empty.mcap").close()
    with pytest.raises(InputError, match="no messages to play"):
        PlaybackServer(tmp_path / "empty.mcap", "127.0.0.1", free_port())

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Frames of the carriers: damaged ones end a connection with a typed error, and never the program."""

from __future__ import annotations

import socket
import struct
import threading
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from cdff_common.errors import CodecError, InputError
from services.yarp.bottle import encode_bottle
from services.yarp.carriers import IncomingConnection, Received
from tests.support.yarp_peer import TCP

_NAME = b"/imu\0"
_HELLO = TCP + struct.pack("<I", len(_NAME)) + _NAME


def _message(data: bytes, envelope: bytes = b"") -> bytes:
    blocks = [b"\0\0\0\0~d\0\1", data]
    if envelope:
        blocks = [struct.pack("<I", len(envelope)) + b"~\0\0\1", envelope, data]
    sizes = b"".join(struct.pack("<I", len(block)) for block in blocks)
    return b"YA\x0a\0\0\0RP" + bytes([len(blocks), 1]) + b"\xff" * 8 + sizes + bytes(4) + b"".join(blocks)


def _received(stream: bytes, max_bytes: int = 1 << 20) -> list[Received | None]:
    """The messages in the bytes of a connection, until its error or its end."""
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.settimeout(0.05)

        def write() -> None:
            with suppress(OSError):  # the connection is refused before its end
                theirs.sendall(stream)
                theirs.shutdown(socket.SHUT_WR)

        thread = threading.Thread(target=write)
        thread.start()
        messages = []
        try:
            connection = IncomingConnection(ours, 8080)
            while True:
                messages.append(connection.receive(max_bytes))
        except EOFError:
            return messages
        finally:
            ours.close()
            thread.join()


def test_messages_with_and_without_an_envelope_are_received() -> None:
    stream = _HELLO + _message(b"one") + _message(b"two", b"D 12 1600000000.25\0")
    assert _received(stream) == [
        Received(b"one", 0, False),
        Received(b"two", 1_600_000_000_250_000_000, False),
    ]


def test_a_connection_of_a_machine_that_is_switched_off_ends_within_a_minute() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        theirs = socket.create_connection(listener.getsockname())
        ours, _ = listener.accept()
        with ours, theirs:
            theirs.sendall(_HELLO)
            IncomingConnection(ours, 8080)
            idle_s, interval_s, count = (
                ours.getsockopt(socket.IPPROTO_TCP, option)
                for option in (socket.TCP_KEEPIDLE, socket.TCP_KEEPINTVL, socket.TCP_KEEPCNT)
            )
            assert ours.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
            assert idle_s + interval_s * count <= 60


def test_text_is_received_and_commands_are_ignored() -> None:
    stream = b"CONNECT /imu\n*\ndo 7 1600000000.5\n1 2 3\nd\nhello\n"
    assert _received(stream) == [
        None,
        Received(b"1 2 3", 1_600_000_000_500_000_000, True),
        Received(b"hello", 0, True),
    ]


@pytest.mark.parametrize(
    ("stream", "error"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", CodecError),
        (TCP + struct.pack("<I", 0xFFFFFFFF), CodecError),
        (_HELLO + b"YA\xff\xff\xff\xffRP", CodecError),
        (_HELLO + b"YA\x0a\0\0\0RP\x01\x01" + b"\xff" * 8 + b"\xff\xff\xff\xff" + bytes(4), InputError),
        (_HELLO + _message(bytes(2 << 20)), InputError),
    ],
)
def test_malformed_and_large_frames_are_refused(stream: bytes, error: type[Exception]) -> None:
    with pytest.raises(error):
        _received(stream)


@pytest.mark.parametrize(
    "count",
    [pytest.param(10_000, marks=pytest.mark.slow), pytest.param(1_000_000, marks=pytest.mark.soak)],
)
def test_mutated_frames_end_in_messages_or_typed_errors(count: int, rng: np.random.Generator) -> None:
    whole = _HELLO + _message(encode_bottle(np.arange(12.0)), b"D 12 1600000000.25\0") + _message(b"x" * 40)
    outcomes: dict[str, int] = {}
    for _ in range(count):
        damaged = bytearray(whole)
        for _ in range(rng.integers(1, 6)):
            damaged[rng.integers(len(damaged))] = rng.integers(256)
        try:
            outcome: Any = f"{len(_received(bytes(damaged[: rng.integers(8, len(damaged) + 1)])))} messages"
        except (CodecError, InputError) as error:
            outcome = type(error).__name__
        outcomes[outcome] = outcomes.get(outcome, 0) + 1
    print(outcomes)
    assert sum(outcomes.values()) == count
    assert outcomes["CodecError"] > count // 100
    assert outcomes["InputError"] > count // 100

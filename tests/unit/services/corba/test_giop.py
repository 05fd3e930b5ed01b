# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calls of remote objects: fragments, forwarding, exceptions and malformed answers of a small server."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from cdff_common.errors import CodecError, UnavailableError
from services.corba.cdr import CdrWriter
from services.corba.giop import GiopConnection, RemoteError

_REPLY, _FRAGMENT = 1, 7


def _message(kind: int, body: bytes, flags: int = 1) -> bytes:
    return b"GIOP\1\2" + bytes([flags, kind]) + struct.pack("<I", len(body)) + body


def _reply(status: int, content: Callable[[CdrWriter], None], request_id: int = 1) -> bytes:
    writer = CdrWriter(bytes(12))
    for number in (request_id, status, 0):
        writer.number("ulong", number)
    writer.align(8)
    content(writer)
    return _message(_REPLY, bytes(writer.data[12:]))


@contextmanager
def server(*answers: bytes) -> Iterator[GiopConnection]:
    """Yield a connection to a server that answers the requests of one client with the given bytes."""
    listener = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        client, _ = listener.accept()
        with client:
            for answer in answers:
                if not client.recv(65536):
                    return
                client.sendall(answer)

    thread = threading.Thread(target=serve)
    thread.start()
    connection = GiopConnection("127.0.0.1", listener.getsockname()[1])
    try:
        yield connection
    finally:
        connection.close()
        thread.join()
        listener.close()


def test_a_reply_in_fragments_is_put_together() -> None:
    whole = _reply(0, lambda writer: writer.text("a" * 100))[12:]
    parts = _message(_REPLY, whole[:36], flags=3) + _message(_FRAGMENT, struct.pack("<I", 1) + whole[36:])
    with server(parts) as connection:
        assert connection.call(b"key", "name").text() == "a" * 100


def test_exceptions_state_their_interface_id() -> None:
    answer = _reply(1, lambda writer: writer.text("IDL:RTT/corba/CNoSuchPortException:1.0"))
    with server(answer) as connection, pytest.raises(RemoteError, match="CNoSuchPort") as error:
        connection.call(b"key", "buildChannelInput")
    assert error.value.exception == "IDL:RTT/corba/CNoSuchPortException:1.0"


def test_a_request_is_forwarded_to_the_object_that_the_answer_names() -> None:
    with server(_reply(0, lambda writer: writer.number("ulong", 7))) as other:
        host, port = other._address

        def reference(writer: CdrWriter) -> None:
            writer.text("")
            writer.number("ulong", 1)
            writer.number("ulong", 0)
            profile = CdrWriter(b"\1\1\2")
            profile.text(host)
            profile.number("ushort", port)
            profile.octets(b"other")
            writer.encapsulation(profile)

        with server(_reply(3, reference)) as connection:
            assert connection.call(b"key", "resolve").number("ulong") == 7


@pytest.mark.parametrize(
    "answer",
    [
        b"HTTP/1.1 400 Bad Request\r\n\r\n",
        b"GIOP\1\2\1\1" + struct.pack("<I", 0xFFFFFFFF),
        _message(_REPLY, struct.pack("<III", 1, 0, 0xFFFFFFF0)),
        _message(6, b""),
        _message(99, b""),
        _message(_REPLY, b"\1"),
    ],
)
def test_malformed_answers_are_refused(answer: bytes) -> None:
    with server(answer) as connection, pytest.raises((CodecError, UnavailableError)):
        connection.call(b"key", "name")


def test_a_server_that_ends_is_unavailable() -> None:
    with server() as connection, pytest.raises(UnavailableError, match="ports"):
        connection.call(b"key", "ports")

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Objects that a client of this project calls: results, exceptions, and malformed messages."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator, Mapping
from contextlib import suppress

import numpy as np
import pytest

from cdff_common.errors import CodecError
from services.corba.cdr import CdrReader, CdrWriter
from services.corba.giop import (
    Connections,
    GiopConnection,
    RemoteError,
    RemoteObject,
    _request,
    read_reference,
    write_reference,
)
from services.corba.server import GiopServer, Operation, UserError


def _double(arguments: CdrReader, results: CdrWriter) -> None:
    results.number("long", 1)
    results.number("double", 2.0 * arguments.number("double"))


def _refuse(_: CdrReader, __: CdrWriter) -> None:
    raise UserError("IDL:test/Refused:1.0", lambda writer: writer.text("why"))


def _fail(_: CdrReader, __: CdrWriter) -> None:
    raise RuntimeError("a fault of the program")


class _Doubler:
    type_id = "IDL:test/Doubler:1.0"
    operations: Mapping[str, Operation] = {"double": _double, "refuse": _refuse, "fail": _fail}


@pytest.fixture
def server() -> Iterator[GiopServer]:
    server = GiopServer("127.0.0.1", {b"key": _Doubler()})
    yield server
    server.close()
    server.thread.join(5.0)
    assert not server.thread.is_alive()


@pytest.fixture
def connection(server: GiopServer) -> Iterator[GiopConnection]:
    reference = server.reference(b"key")
    connection = GiopConnection(reference.host, reference.port)
    yield connection
    connection.close()


def test_an_operation_returns_its_results(connection: GiopConnection) -> None:
    reader = connection.call(b"key", "double", lambda writer: writer.number("double", 1.25))
    assert (reader.number("long"), reader.number("double")) == (1, 2.5)
    assert connection.call(b"key", "_is_a", lambda w: w.text("IDL:test/Doubler:1.0")).number("boolean") == 1
    assert connection.call(b"key", "_non_existent").number("boolean") == 0


@pytest.mark.parametrize(
    ("key", "operation", "exception"),
    [
        (b"key", "refuse", "IDL:test/Refused:1.0"),
        (b"key", "fail", "IDL:omg.org/CORBA/INTERNAL:1.0"),
        (b"key", "double", "IDL:omg.org/CORBA/MARSHAL:1.0"),
        (b"key", "triple", "IDL:omg.org/CORBA/BAD_OPERATION:1.0"),
        (b"other", "double", "IDL:omg.org/CORBA/OBJECT_NOT_EXIST:1.0"),
    ],
)
def test_a_call_that_fails_has_an_exception_and_the_connection_goes_on(
    connection: GiopConnection, key: bytes, operation: str, exception: str
) -> None:
    with pytest.raises(RemoteError) as error:
        connection.call(key, operation)
    assert error.value.exception == exception
    assert connection.call(b"key", "_non_existent").number("boolean") == 0


def test_a_reference_is_read_as_it_was_written(server: GiopServer) -> None:
    writer = CdrWriter()
    write_reference(writer, server.reference(b"key"))
    write_reference(writer, None)
    reader = CdrReader(bytes(writer.data), is_little=True)
    assert read_reference(reader) == server.reference(b"key")
    assert read_reference(reader) is None
    connections = Connections()
    found = RemoteObject(server.reference(b"key"), connections).call("_non_existent")
    connections.close()
    assert found.number("boolean") == 0


@pytest.mark.parametrize(
    "data",
    [
        b"HTTP/1.1 400 Bad Request\r\n\r\n",
        b"GIOP\1\2\1\0" + struct.pack("<I", 0xFFFFFFFF),
        b"GIOP\1\2\1\0" + struct.pack("<I", 8) + bytes(8),
        b"GIOP\1\2\1\1" + struct.pack("<I", 4) + bytes(4),
        b"GIOP\1\2\3\0" + struct.pack("<I", 4) + bytes(4) + b"GIOP\1\2\1\0" + bytes(4),
    ],
)
def test_a_malformed_message_ends_its_connection_only(server: GiopServer, data: bytes) -> None:
    host, port = server.reference(b"key").host, server.reference(b"key").port
    with socket.create_connection((host, port), timeout=5.0) as client:
        client.sendall(data)
        assert client.recv(64)[:8] in (b"GIOP\1\2\1\6", b"")
    connection = GiopConnection(host, port)
    assert connection.call(b"key", "_non_existent").number("boolean") == 0
    connection.close()


def test_mutated_requests_are_answered_or_refused(server: GiopServer) -> None:
    request = _request(1, b"key", "double", lambda writer: writer.number("double", 1.0))
    rng = np.random.default_rng(0)
    for _ in range(2000):
        data = bytearray(request)
        for position in rng.integers(0, len(data), rng.integers(1, 5)):
            data[position] = rng.integers(256)
        with suppress(CodecError):
            server.answer(bytes(data), data[7], bool(data[6] & 1))

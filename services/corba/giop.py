# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calls of remote objects by GIOP 1.2 over TCP, and references of objects (§9.4 and §9.7)."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

from cdff_common.errors import CodecError, UnavailableError
from services.corba.cdr import CdrReader, CdrWriter
from services.corba.messages import (
    CLOSE,
    ERROR,
    HEADER,
    REPLY,
    REQUEST,
    finish_message,
    read_message,
    receive_bytes,
    skip_contexts,
)

_NO_EXCEPTION, _USER_EXCEPTION, _SYSTEM_EXCEPTION, _FORWARD, _FORWARD_PERMANENTLY = range(5)
#: Time of a call, seconds; calls that are forwarded to another object; largest message, bytes.
_TIMEOUT_S, _MAX_FORWARDS, _MAX_BYTES = 5.0, 4, 1 << 28
#: Tags of the profiles of a reference: internet.
_INTERNET = 0

Marshal = Callable[[CdrWriter], None]


@dataclass(frozen=True, slots=True)
class Reference:
    """Reference of a remote object.

    Attributes
    ----------
    type_id : str
        Repository id of its interface; empty if unknown.
    host : str
    port : int
    key : bytes
    """

    type_id: str
    host: str
    port: int
    key: bytes


def write_reference(writer: CdrWriter, reference: Reference | None) -> None:
    """Add the reference of an object; None is nil."""
    writer.text(reference.type_id if reference else "")
    writer.number("ulong", 1 if reference else 0)
    if reference:
        writer.number("ulong", _INTERNET)
        profile = CdrWriter(b"\1\1\2")  # byte order, and version 1.2
        profile.text(reference.host)
        profile.number("ushort", reference.port)
        profile.octets(reference.key)
        profile.number("ulong", 0)  # no components
        writer.encapsulation(profile)


class RemoteError(UnavailableError):
    """A call that the remote object has answered with an exception.

    Attributes
    ----------
    exception : str
        Repository id, such as ``IDL:RTT/corba/CNoSuchPortException:1.0``.
    """

    def __init__(self, message: str, exception: str) -> None:
        super().__init__(message)
        self.exception = exception


def read_reference(reader: CdrReader) -> Reference | None:
    """Return the reference of an object; None for nil, or for an object without an address of TCP."""
    type_id, found = reader.text(), None
    for _ in range(reader.count(8)):
        tag = reader.number("ulong")
        profile = reader.encapsulation()
        if tag == _INTERNET and found is None:
            profile.take(2)
            host, port = profile.text(), profile.number("ushort")
            found = Reference(type_id, host, port, profile.octets())
    return found


class GiopConnection:
    """Connection to the process of remote objects; calls are made one after the other.

    It is made with the first call, and again after it is lost.

    Parameters
    ----------
    host : str
    port : int
    """

    def __init__(self, host: str, port: int) -> None:
        self._address = host, port
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self._is_closed = False
        self._last_id = 0

    def close(self) -> None:
        """Close the connection permanently; a call that waits for its reply fails."""
        self._is_closed = True
        self._disconnect()

    def _disconnect(self) -> None:
        sock = self._socket
        if sock is not None:
            with suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)
            sock.close()
        self._socket = None

    def call(self, key: bytes, operation: str, marshal: Marshal | None = None) -> CdrReader:
        """Return the results of an operation.

        Raises
        ------
        RemoteError
            If the object answers with an exception.
        UnavailableError
            If the process does not answer.
        CodecError
            If the answer is malformed; the connection is closed.
        """
        return self._call(key, operation, marshal, 0)

    def _call(self, key: bytes, operation: str, marshal: Marshal | None, forwards: int) -> CdrReader:
        with self._lock:
            try:
                self._last_id = (self._last_id + 1) % (1 << 31)
                self._send(_request(self._last_id, key, operation, marshal))
                status, reader = self._reply(self._last_id)
            except (OSError, EOFError) as error:
                self._disconnect()
                host, port = self._address
                raise UnavailableError(f"{host}:{port}: {operation}: {error}") from error
            except CodecError:
                self._disconnect()
                raise
        if status in (_FORWARD, _FORWARD_PERMANENTLY):
            target = read_reference(reader)
            if target is None or forwards >= _MAX_FORWARDS:
                raise UnavailableError(f"{operation}: forwarded to an object without an address")
            if (target.host, target.port) == self._address:
                return self._call(target.key, operation, marshal, forwards + 1)
            other = GiopConnection(target.host, target.port)
            try:
                return other._call(target.key, operation, marshal, forwards + 1)
            finally:
                other.close()
        if status in (_USER_EXCEPTION, _SYSTEM_EXCEPTION):
            exception = reader.text()
            raise RemoteError(f"{operation}: {exception}", exception)
        return reader

    def _send(self, message: bytes) -> None:
        if self._is_closed:
            raise EOFError("the connection is closed")
        if self._socket is None:
            sock = socket.create_connection(self._address, timeout=_TIMEOUT_S)
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket = sock
            if self._is_closed:  # meanwhile, by another thread
                raise EOFError("the connection is closed")
        self._socket.sendall(message)

    def _reply(self, request_id: int) -> tuple[int, CdrReader]:
        """Return status and results of the reply to a request."""
        while True:
            data, kind, is_little = read_message(self._receive, _MAX_BYTES)
            if kind == CLOSE:
                raise EOFError("the server has closed the connection")
            if kind == ERROR:
                raise CodecError("the server reports a malformed message")
            if kind != REPLY:
                raise CodecError(f"GIOP message of kind {kind}: expected a reply")
            reader = CdrReader(data, is_little, HEADER.size)
            found, status = reader.number("ulong"), reader.number("ulong")
            skip_contexts(reader)
            if found == request_id:
                return status, reader

    def _receive(self, size: int) -> bytes:
        if self._socket is None:
            raise EOFError("the connection is closed")
        return receive_bytes(self._socket, size)


def _request(request_id: int, key: bytes, operation: str, marshal: Marshal | None) -> bytes:
    """Return the message of a request."""
    writer = CdrWriter(bytes(HEADER.size))
    writer.number("ulong", request_id)
    writer.data += b"\3\0\0\0"  # a reply is expected
    writer.number("short", 0)  # the target is stated by its key
    writer.octets(key)
    writer.text(operation)
    writer.number("ulong", 0)  # no service contexts
    if marshal is not None:
        writer.align(8)
        marshal(writer)
    return finish_message(writer, REQUEST)


class RemoteObject:
    """A remote object and the connection to it.

    Parameters
    ----------
    reference : Reference
    connections : Connections
    """

    def __init__(self, reference: Reference, connections: Connections) -> None:
        self.reference, self._connections = reference, connections

    def call(self, operation: str, marshal: Marshal | None = None) -> CdrReader:
        """Return the results of an operation; raises as ``GiopConnection.call``."""
        connection = self._connections.to(self.reference.host, self.reference.port)
        return connection.call(self.reference.key, operation, marshal)

    def object_of(self, reader: CdrReader) -> RemoteObject:
        """Return the object of the next reference; raises UnavailableError if it has no address."""
        reference = read_reference(reader)
        if reference is None:
            raise UnavailableError("the object does not exist, or has no address of TCP")
        return RemoteObject(reference, self._connections)


class Connections:
    """Connections to the processes of remote objects, by address."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._is_closed = False
        self._by_address: dict[tuple[str, int], GiopConnection] = {}

    def to(self, host: str, port: int) -> GiopConnection:
        """Return the connection to an address; raises UnavailableError after ``close``."""
        with self._lock:
            if self._is_closed:
                raise UnavailableError("the connections are closed")
            return self._by_address.setdefault((host, port), GiopConnection(host, port))

    def close(self) -> None:
        """Close all connections; calls that wait for their reply fail."""
        with self._lock:
            self._is_closed = True
            connections = list(self._by_address.values())
            self._by_address.clear()
        for connection in connections:
            connection.close()

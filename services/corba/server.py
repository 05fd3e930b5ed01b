# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Objects that other processes call by GIOP 1.2 over TCP."""

from __future__ import annotations

import logging
import socket
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Protocol

from cdff_common.errors import CodecError
from services.corba.cdr import CdrReader, CdrWriter
from services.corba.giop import Marshal, Reference
from services.corba.messages import (
    CLOSE,
    ERROR,
    HEADER,
    LOCATE_REPLY,
    LOCATE_REQUEST,
    REPLY,
    REQUEST,
    finish_message,
    read_message,
    receive_bytes,
    skip_contexts,
)

logger = logging.getLogger(__name__)

_NO_EXCEPTION, _USER_EXCEPTION, _SYSTEM_EXCEPTION = range(3)
_UNKNOWN_OBJECT, _OBJECT_HERE = 0, 1
#: The call was not completed.
_NOT_COMPLETED = 1
#: Connections at a time, largest message in bytes, and time of a connection without a call, seconds.
_MAX_CONNECTIONS, _MAX_BYTES, _IDLE_S = 16, 1 << 20, 600.0

#: An operation: reads its arguments and adds its results.
Operation = Callable[[CdrReader, CdrWriter], None]


class Servant(Protocol):
    """An object with its operations by name."""

    @property
    def type_id(self) -> str:
        """Repository id of its interface."""

    @property
    def operations(self) -> Mapping[str, Operation]:
        """Operations by name."""


class UserError(Exception):
    """An exception of an interface, which the caller receives.

    Attributes
    ----------
    exception : str
        Repository id.
    marshal : callable
        Adds its members.
    """

    def __init__(self, exception: str, marshal: Marshal) -> None:
        super().__init__(exception)
        self.exception, self.marshal = exception, marshal


class _SystemError(Exception):
    """A system exception of CORBA by its name, such as ``BAD_OPERATION``."""


class GiopServer:
    """Server of objects; each connection has a thread of its own.

    Parameters
    ----------
    host : str
        Address to listen on.
    objects : mapping of bytes to Servant
        Objects by their keys.
    """

    def __init__(self, host: str, objects: Mapping[bytes, Servant]) -> None:
        self._objects, self._lock = objects, threading.Lock()
        self._listener = socket.create_server((host, 0))
        self._address: tuple[str, int] = (host, self._listener.getsockname()[1])
        self._clients: set[socket.socket] = set()
        self._closed = threading.Event()
        self.refused = 0
        self.thread = threading.Thread(target=self._accept, name="CORBA server", daemon=True)
        self.thread.start()

    def reference(self, key: bytes) -> Reference:
        """Return the reference of an object by its key."""
        return Reference(self._objects[key].type_id, *self._address, key)

    def close(self) -> None:
        """End all connections."""
        self._closed.set()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._lock:
            clients = list(self._clients)
        for client in clients:
            with suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)

    def _accept(self) -> None:
        while not self._closed.is_set():
            try:
                client, _ = self._listener.accept()
            except OSError:
                continue
            with self._lock:
                is_refused = len(self._clients) >= _MAX_CONNECTIONS or self._closed.is_set()
                if not is_refused:
                    self._clients.add(client)
            if is_refused:
                self.refused += 1
                client.close()
                continue
            threading.Thread(target=self._serve, args=(client,), name="CORBA client", daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        try:
            client.settimeout(_IDLE_S)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            while True:
                data, kind, is_little = read_message(lambda size: receive_bytes(client, size), _MAX_BYTES)
                if kind == CLOSE:
                    return
                answer = self.answer(data, kind, is_little)
                if answer:
                    client.sendall(answer)
        except (OSError, EOFError):
            return
        except CodecError as error:
            logger.warning("a CORBA client sends a malformed message: %s", error)
            with suppress(OSError):
                client.sendall(finish_message(CdrWriter(bytes(HEADER.size)), ERROR))
        finally:
            with self._lock:
                self._clients.discard(client)
            client.close()

    def answer(self, data: bytes, kind: int, is_little: bool) -> bytes:
        """Return the answer to a message with its header; empty without an answer.

        Raises
        ------
        CodecError
            If the header of the request is malformed.
        """
        reader = CdrReader(data, is_little, HEADER.size)
        if kind == LOCATE_REQUEST:
            request_id = reader.number("ulong")
            writer = CdrWriter(bytes(HEADER.size))
            writer.number("ulong", request_id)
            writer.number("ulong", _OBJECT_HERE if _key(reader) in self._objects else _UNKNOWN_OBJECT)
            return finish_message(writer, LOCATE_REPLY)
        if kind != REQUEST:
            raise CodecError(f"GIOP message of kind {kind}: expected a request")
        request_id, is_answered = reader.number("ulong"), bool(reader.take(4)[0] & 1)
        key, name = _key(reader), reader.text()
        skip_contexts(reader)
        status, marshal = self._call(key, name, reader)
        if not is_answered:
            return b""
        writer = CdrWriter(bytes(HEADER.size))
        for number in (request_id, status, 0):
            writer.number("ulong", number)
        writer.align(8)
        marshal(writer)
        return finish_message(writer, REPLY)

    def _call(self, key: bytes, name: str, reader: CdrReader) -> tuple[int, Marshal]:
        """Return the status of a call, and what adds its results."""
        # Results are aligned as in the message, where they begin at a multiple of 8.
        results = CdrWriter()
        try:
            self._operation(key, name)(reader, results)
        except UserError as error:
            return _USER_EXCEPTION, _exception(error.exception, error.marshal)
        except _SystemError as error:
            return _SYSTEM_EXCEPTION, _system_exception(str(error))
        except CodecError as error:
            logger.warning("%s: %s", name[:80], error)
            return _SYSTEM_EXCEPTION, _system_exception("MARSHAL")
        except Exception:
            logger.exception("%s failed", name[:80])
            return _SYSTEM_EXCEPTION, _system_exception("INTERNAL")

        def add(writer: CdrWriter) -> None:
            writer.data += results.data

        return _NO_EXCEPTION, add

    def _operation(self, key: bytes, name: str) -> Operation:
        servant = self._objects.get(key)
        if servant is None:
            raise _SystemError("OBJECT_NOT_EXIST")
        if name == "_non_existent":
            return lambda _, results: results.number("boolean", 0)
        if name == "_is_a":
            return lambda arguments, results: results.number("boolean", arguments.text() == servant.type_id)
        operation = servant.operations.get(name)
        if operation is None:
            raise _SystemError("BAD_OPERATION")
        return operation


def _key(reader: CdrReader) -> bytes:
    """Return the key of the target of a request; raises CodecError if it is stated in another way."""
    form = reader.number("short")
    if form != 0:
        raise CodecError(f"target of the form {form}: expected an object key")
    return reader.octets()


def _exception(repository_id: str, members: Marshal) -> Marshal:
    def add(writer: CdrWriter) -> None:
        writer.text(repository_id)
        members(writer)

    return add


def _system_exception(name: str) -> Marshal:
    def members(writer: CdrWriter) -> None:
        writer.number("ulong", 0)
        writer.number("ulong", _NOT_COMPLETED)

    return _exception(f"IDL:omg.org/CORBA/{name}:1.0", members)

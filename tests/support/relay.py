# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A simulated radio link: a TCP relay that can stop passing data without an error at either end."""

from __future__ import annotations

import selectors
import socket
import threading
from types import TracebackType
from typing import Self

#: Period at which the thread checks whether it must stop passing data, or end.
_STEP_S = 0.1
_CHUNK = 1 << 16


class Relay:
    """Context manager that passes bytes between its clients and a TCP server.

    Parameters
    ----------
    to : tuple of (str, int)
        Address of the server.
    """

    def __init__(self, to: tuple[str, int]) -> None:
        self._to = to
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self._silent = threading.Event()
        self._ended = threading.Event()
        self._peers: dict[socket.socket, socket.socket] = {}
        self._selector = selectors.DefaultSelector()
        self._thread = threading.Thread(target=self._run, name="relay", daemon=True)

    def __enter__(self) -> Self:
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
        self._close_all()
        self._listener.close()

    def cut(self) -> None:
        """Stop passing data: connections stay open, new connections are not accepted."""
        self._silent.set()

    def restore(self) -> None:
        """Pass data again; close the connections that were open during the interruption."""
        self._silent.clear()

    def _run(self) -> None:
        while not self._ended.is_set():
            if self._silent.is_set():
                while self._silent.is_set() and not self._ended.wait(_STEP_S):
                    pass
                self._close_all()
            for key, _ in self._selector.select(_STEP_S):
                if key.fileobj is self._listener:
                    self._accept()
                elif isinstance(key.fileobj, socket.socket) and key.fileobj in self._peers:
                    self._pass(key.fileobj)

    def _accept(self) -> None:
        client, _ = self._listener.accept()
        try:
            server = socket.create_connection(self._to, timeout=2.0)
        except OSError:
            client.close()
            return
        server.settimeout(None)
        for source, target in ((client, server), (server, client)):
            source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._peers[source] = target
            self._selector.register(source, selectors.EVENT_READ)

    def _pass(self, source: socket.socket) -> None:
        try:
            data = source.recv(_CHUNK)
            if data:
                self._peers[source].sendall(data)
                return
        except OSError:
            pass
        self._close(source)

    def _close(self, connection: socket.socket) -> None:
        for end in (connection, self._peers[connection]):
            del self._peers[end]
            self._selector.unregister(end)
            end.close()

    def _close_all(self) -> None:
        while self._peers:
            self._close(next(iter(self._peers)))

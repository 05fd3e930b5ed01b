# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A radio link for tests: a TCP relay that can fall silent, so that neither end is told that nothing arrives."""

from __future__ import annotations

import selectors
import socket
import threading
from types import TracebackType
from typing import Self

_STEP_S = 0.1
_CHUNK = 1 << 16


class Relay:
    """Passes bytes between those who connect and a TCP server; a context manager.

    Parameters
    ----------
    to : tuple of (str, int)
        The server.
    """

    def __init__(self, to: tuple[str, int]) -> None:
        self._to = to
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        self._silent = threading.Event()
        self._ended = threading.Event()
        self._partners: dict[socket.socket, socket.socket] = {}
        self._selector = selectors.DefaultSelector()
        self._thread = threading.Thread(target=self._run, name="relay", daemon=True)

    def __enter__(self) -> Self:
        self._selector.register(self._listening, selectors.EVENT_READ)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
        self._close_all()
        self._listening.close()

    def cut(self) -> None:
        """Fall silent: what is connected stays so and nothing passes, new connections are not answered."""
        self._silent.set()

    def restore(self) -> None:
        """Pass again; connections of before are closed."""
        self._silent.clear()

    def _run(self) -> None:
        while not self._ended.is_set():
            if self._silent.is_set():
                while self._silent.is_set() and not self._ended.wait(_STEP_S):
                    pass
                self._close_all()
            for key, _ in self._selector.select(_STEP_S):
                if key.fileobj is self._listening:
                    self._accept()
                elif isinstance(key.fileobj, socket.socket) and key.fileobj in self._partners:
                    self._pass(key.fileobj)

    def _accept(self) -> None:
        client, _ = self._listening.accept()
        try:
            server = socket.create_connection(self._to, timeout=2.0)
        except OSError:
            client.close()
            return
        server.settimeout(None)
        for one, other in ((client, server), (server, client)):
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._partners[one] = other
            self._selector.register(one, selectors.EVENT_READ)

    def _pass(self, source: socket.socket) -> None:
        try:
            data = source.recv(_CHUNK)
            if data:
                self._partners[source].sendall(data)
                return
        except OSError:
            pass
        self._close(source)

    def _close(self, one: socket.socket) -> None:
        for end in (one, self._partners[one]):
            del self._partners[end]
            self._selector.unregister(end)
            end.close()

    def _close_all(self) -> None:
        while self._partners:
            self._close(next(iter(self._partners)))

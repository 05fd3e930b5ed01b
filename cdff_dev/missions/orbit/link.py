# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A relay of TCP connections to the router, which can be interrupted as a fault."""

from __future__ import annotations

import selectors
import socket
import threading
from types import TracebackType
from typing import Self

from cdff_dev.ports import split_address

_PART_BYTES = 1 << 16


class InterruptibleLink:
    """Context manager that relays connections from a free port on loopback to the router.

    Parameters
    ----------
    router : str
        Endpoint of the router, such as ``tcp/127.0.0.1:7447``.

    Attributes
    ----------
    endpoint : str
        Endpoint to which clients connect.
    """

    def __init__(self, router: str) -> None:
        self._router = split_address(router, "router")
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._listener.getsockname()[1]}"
        self._is_cut, self._stop = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._relay, name="link", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
        self._listener.close()

    def cut(self) -> None:
        """Close all connections and refuse new ones until ``restore``."""
        self._is_cut.set()

    def restore(self) -> None:
        """Relay new connections again."""
        self._is_cut.clear()

    def _relay(self) -> None:
        """Relay in both directions until the end."""
        peers: dict[socket.socket, socket.socket] = {}
        with selectors.DefaultSelector() as selector:

            def close(*ends: socket.socket) -> None:
                for end in ends:
                    if peers.pop(end, None) is not None:
                        selector.unregister(end)
                        end.close()

            selector.register(self._listener, selectors.EVENT_READ)
            while not self._stop.is_set():
                if self._is_cut.is_set():
                    close(*list(peers))
                for key, _ in selector.select(0.05):
                    if key.fileobj is self._listener:
                        self._accept(selector, peers)
                        continue
                    source = key.fileobj
                    assert isinstance(source, socket.socket)
                    if source not in peers:  # closed with its peer
                        continue
                    try:
                        data = source.recv(_PART_BYTES)
                        peers[source].sendall(data)
                    except OSError:
                        data = b""
                    if not data:
                        close(source, peers[source])
            close(*list(peers))

    def _accept(self, selector: selectors.BaseSelector, peers: dict[socket.socket, socket.socket]) -> None:
        """Connect a new client with the router, or close its connection during an outage."""
        client, _ = self._listener.accept()
        if self._is_cut.is_set():
            client.close()
            return
        try:
            router = socket.create_connection(self._router, 5.0)
        except OSError:
            client.close()
            return
        router.settimeout(None)
        for end, peer in ((client, router), (router, client)):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            peers[end] = peer
            selector.register(end, selectors.EVENT_READ)

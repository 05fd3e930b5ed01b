# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Connections of the HTTP server: deadlines for headers and for slow readers, and a bound of idle ones.

A connection is idle while it has no request in progress. Idle connections beyond a bound are closed, those
that have been idle longest first, so that silent clients never keep others from connecting.
"""

from __future__ import annotations

import asyncio
from collections import defaultdict
from typing import Any

import h11
from uvicorn.protocols.http.h11_impl import H11Protocol

from services.dpm.http.middleware.members import COMMON_NAME, common_name
from services.dpm.http.middleware.problems import problem

#: Time for the header of a request, and for the client to read a part of an answer, seconds.
HEADER_S, READ_S = 10.0, 30.0
#: Time for which the rest of a refused request is read and discarded, seconds.
LINGER_S = 2.0
#: Largest header of a request, the default of uvicorn.
_HEADER_BYTES = 64 << 10
#: Idle connections in total and of one address; more than a client opens at once. Together with the requests
#: in progress they need less than 1024 descriptors, the usual limit of a process.
MAX_IDLE, MAX_IDLE_OF_ADDRESS = 512, 384


class IdleConnections:
    """The idle connections of a server by address, longest idle first."""

    def __init__(self, max_idle: int = MAX_IDLE, max_of_address: int = MAX_IDLE_OF_ADDRESS) -> None:
        self._max_idle, self._max_of_address = max_idle, max_of_address
        self._count = 0
        self._by_address: dict[str, dict[BoundedConnection, None]] = defaultdict(dict)

    def add(self, connection: BoundedConnection) -> None:
        """Add a connection; close another one if there are too many."""
        self._by_address[connection.address][connection] = None
        self._count += 1
        crowded = self._by_address[connection.address]
        if len(crowded) <= self._max_of_address:
            if self._count <= self._max_idle:
                return
            crowded = max(self._by_address.values(), key=len)
        oldest = next(iter(crowded))
        self.remove(oldest)
        oldest.transport.abort()

    def remove(self, connection: BoundedConnection) -> None:
        """Remove a connection that ends or has a request, if it was idle."""
        of_address = self._by_address.get(connection.address, {})
        if connection in of_address:
            del of_address[connection]
            self._count -= 1
            if not of_address:
                del self._by_address[connection.address]


class BoundedConnection(H11Protocol):
    """HTTP/1.1 connection that ends if a header or the reading of an answer takes too long."""

    def __init__(self, idle: IdleConnections, **arguments: Any) -> None:
        super().__init__(**arguments)
        self._idle = idle
        self._header_timer: asyncio.TimerHandle | None = None
        self._read_timer: asyncio.TimerHandle | None = None
        self._linger_timer: asyncio.TimerHandle | None = None
        self.address = ""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Enter the caller's certificate in the scope, and start the deadline of the first header."""
        super().connection_made(transport)
        self.address = self.client[0] if self.client else ""
        self.app_state = {**self.app_state, COMMON_NAME: common_name(transport)}
        self._update()

    def data_received(self, data: bytes) -> None:
        """Receive a part of a request; the rest of a refused one is discarded."""
        if self._linger_timer is not None:
            return
        super().data_received(data)
        self._update()

    def on_response_complete(self) -> None:
        """Start the deadline of the next header."""
        super().on_response_complete()
        self._update()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the deadlines."""
        super().connection_lost(exc)
        if self._linger_timer is not None:
            self._linger_timer.cancel()
        self._stop_header_timer()
        self.resume_writing()

    def send_400_response(self, msg: str) -> None:
        """Answer a request that is not HTTP, or whose header is too large, with a problem document.

        The connection stays open for reading for a moment: if it were closed before the client has sent its
        whole request, the client would receive a reset instead of the answer.
        """
        if self.transport.is_closing() or self._linger_timer is not None:
            return
        detail = (
            f"{msg.rstrip('.')}: expected HTTP/1.1 with at most {_HEADER_BYTES} bytes of address and headers"
        )
        body = problem(400, detail, code="INVALID_ARGUMENT")
        head = [(name, value) for name, value in body.raw_headers if name != b"content-length"]
        events = (
            h11.Response(status_code=400, headers=[*head, (b"connection", b"close")], reason=b"Bad Request"),
            h11.Data(data=bytes(body.body)),
            h11.EndOfMessage(),
        )
        for event in events:
            self.transport.write(self.conn.send(event) or b"")
        if self.transport.can_write_eof():
            self.transport.write_eof()
        self._linger_timer = self.loop.call_later(LINGER_S, self.transport.close)

    def pause_writing(self) -> None:
        """Start the deadline of a client that does not read."""
        super().pause_writing()
        if self._read_timer is None:
            self._read_timer = self.loop.call_later(READ_S, self.transport.abort)

    def resume_writing(self) -> None:
        """Stop the deadline of the reading."""
        super().resume_writing()
        if self._read_timer is not None:
            self._read_timer.cancel()
            self._read_timer = None

    def _update(self) -> None:
        """Start the deadline of the header if the connection is idle, otherwise stop it."""
        if self.transport.is_closing() or not (self.cycle is None or self.cycle.response_complete):
            self._stop_header_timer()
        elif self._header_timer is None:
            self._header_timer = self.loop.call_later(HEADER_S, self.transport.abort)
            self._idle.add(self)

    def _stop_header_timer(self) -> None:
        if self._header_timer is not None:
            self._header_timer.cancel()
            self._header_timer = None
        self._idle.remove(self)

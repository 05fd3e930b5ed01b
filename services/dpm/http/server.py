# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The HTTP server, in a thread of the DPM process; its socket is bound first to detect a taken port."""

from __future__ import annotations

import asyncio
import functools
import socket
import threading
from asyncio import sslproto
from contextlib import suppress
from types import TracebackType
from typing import Any, Self, cast

import uvicorn
from anyio import to_thread
from starlette.concurrency import run_in_threadpool

from cdff_common.clock import monotonic_s
from cdff_common.errors import UnavailableError
from services.dpm.http.app import create_app
from services.dpm.http.connections import BoundedConnection, IdleConnections
from services.dpm.http.context import Context
from services.dpm.http.middleware.members import server_options

_STOP_S = 3.0
#: Period in which the date in the headers of answers is renewed, seconds.
_DATE_S = 1.0
#: Interval of the checks of event loop and thread pool, and time after which they count as hung, seconds.
_PROBE_S, _HUNG_S = 5.0, 300.0
#: Requests that are carried out at the same time; others wait. Each has its objects in memory, of which the
#: allocator returns only a part to the system. More threads compete for the interpreter: with 16 of them, 32
#: clients get half of the searches per second.
_THREADS = 4
#: Read buffer of a TLS connection. The default of 256 kB would be 100 MB for the idle connections.
_TLS_BUFFER_BYTES = 64 << 10


class _Server(uvicorn.Server):
    """Server with a smaller thread pool, which is checked like its event loop."""

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self._answered_s: float | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stopped = asyncio.Event()

    async def serve(self, sockets: list[socket.socket] | None = None) -> None:
        """Serve until ``should_exit``."""
        to_thread.current_default_thread_limiter().total_tokens = _THREADS
        self._loop = asyncio.get_running_loop()
        probe = asyncio.create_task(self._probe())
        try:
            await super().serve(sockets)
        finally:
            probe.cancel()

    async def main_loop(self) -> None:
        """Wait for ``stop``; the date in the answers is renewed every second."""
        while not await self.on_tick(0):
            with suppress(TimeoutError):
                await asyncio.wait_for(self._stopped.wait(), _DATE_S)

    def stop(self) -> None:
        """End ``serve``; called by another thread."""
        self.should_exit = True
        if self._loop is not None:
            with suppress(RuntimeError):  # the loop has ended
                self._loop.call_soon_threadsafe(self._stopped.set)

    async def _probe(self) -> None:
        while True:
            self._answered_s = await run_in_threadpool(monotonic_s)
            await asyncio.sleep(_PROBE_S)

    def problem(self) -> str:
        """Return why the server does not work; empty if it does, and before its start."""
        silent_s = 0.0 if self._answered_s is None else monotonic_s() - self._answered_s
        if silent_s <= _HUNG_S:
            return ""
        return f"the HTTP server answers nothing for {silent_s:.0f} s"


class HttpServer:
    """Serves while the context is open.

    Raises
    ------
    UnavailableError
        If the port is taken.
    """

    def __init__(self, context: Context) -> None:
        settings, self._end_streams = context.settings, context.end_streams
        family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if settings.shares_port:  # the system distributes the connections among the processes of the store
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        # connections inherit it; without it, an answer in two parts waits 40 ms for the first to be
        # acknowledged
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            self._socket.bind((settings.host, settings.port))
            self._socket.listen(128)  # callers wait from now on instead of being refused
        except OSError as error:
            self._socket.close()
            raise UnavailableError(
                f"HTTP on {settings.host}:{settings.port}: {error.strerror}; try another --http"
            ) from error
        self.port: int = self._socket.getsockname()[1]
        sslproto.SSLProtocol.max_size = _TLS_BUFFER_BYTES
        config = uvicorn.Config(
            create_app(context),
            log_config=None,
            access_log=False,
            timeout_graceful_shutdown=1,
            server_header=False,
            http=cast(Any, functools.partial(BoundedConnection, IdleConnections())),
            timeout_keep_alive=15,
            lifespan="off",
            **server_options(settings.identity),
        )
        self._server = _Server(config)
        self._thread = threading.Thread(
            target=self._server.run, kwargs={"sockets": [self._socket]}, name="http", daemon=True
        )

    def problem(self) -> str:
        """Return why the server does not work; empty if it does."""
        return self._server.problem()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end_streams()
        self._server.stop()
        self._thread.join(_STOP_S)
        self._socket.close()

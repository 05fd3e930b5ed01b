# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The HTTP server, in a thread of the DPM process; its socket is bound first to detect a taken port."""

from __future__ import annotations

import functools
import socket
import threading
from types import TracebackType
from typing import Any, Self, cast

import uvicorn

from cdff_common.errors import UnavailableError
from services.dpm.http.app import create_app
from services.dpm.http.connections import BoundedConnection, IdleConnections
from services.dpm.http.context import Context
from services.dpm.http.middleware.members import server_options

_STOP_S = 3.0


class HttpServer:
    """Serves while the context is open.

    Raises
    ------
    UnavailableError
        If the port is taken.
    """

    def __init__(self, context: Context) -> None:
        s, self._end_streams = context.settings, context.end_streams
        family = socket.AF_INET6 if ":" in s.host else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # connections inherit it; without it, an answer in two parts waits 40 ms for the first to be
        # acknowledged
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            self._socket.bind((s.host, s.port))
            self._socket.listen(128)  # callers wait from now on instead of being refused
        except OSError as error:
            self._socket.close()
            raise UnavailableError(
                f"HTTP on {s.host}:{s.port}: {error.strerror}; try another --http"
            ) from error
        self.port: int = self._socket.getsockname()[1]
        config = uvicorn.Config(
            create_app(context),
            log_config=None,
            access_log=False,
            timeout_graceful_shutdown=1,
            server_header=False,
            http=cast(Any, functools.partial(BoundedConnection, IdleConnections())),
            timeout_keep_alive=15,
            lifespan="off",
            **server_options(s.identity),
        )
        self._server = uvicorn.Server(config)
        self._thread = threading.Thread(
            target=self._server.run, kwargs={"sockets": [self._socket]}, name="http", daemon=True
        )

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end_streams()
        self._server.should_exit = True
        self._thread.join(_STOP_S)
        self._socket.close()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""HTTP control of a running player, on this machine only: a page for browsers, the status, and the commands
of ``cdff_dev.play.control`` (pause, seek, speed and so on).

``GET /status`` and ``POST /{verb}``, with the parameters of the calls on the bus, answer with the status.
Requests with the ``Host`` of another machine, and writes from pages of another origin, are refused, as by the
DPM.
"""

from __future__ import annotations

import logging
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import uvicorn
from fastapi import FastAPI, Request
from fastapi.responses import FileResponse, Response

from cdff_common.errors import InputError, UnavailableError
from cdff_dev.play.control import PARAMETERS, control
from services.dpm.http.middleware.problems import install, problem

if TYPE_CHECKING:
    from cdff_dev.play.player import Player

HOST = "127.0.0.1"
_HOSTS = (HOST, "localhost")
_PAGE = Path(__file__).with_name("player.html")
_STOP_S = 3.0


def create_app(player: Player, stop: threading.Event) -> FastAPI:
    """Return the application that controls a player; ``stop`` is set to end it."""
    app = FastAPI(title="CDFF player", docs_url=None, redoc_url=None)
    install(app)

    @app.middleware("http")
    async def refuse_others(request: Request, call_next: Any) -> Response:
        host, origin = request.headers.get("host", ""), request.headers.get("origin")
        if host.partition(":")[0] not in _HOSTS:
            return problem(421, f"Host {host[:80]!r}: expected {' or '.join(_HOSTS)}")
        if origin is not None and urlsplit(origin).netloc != host:
            return problem(403, f"Origin {origin[:80]!r} may not control this player")
        answer: Response = await call_next(request)
        return answer

    @app.get("/", include_in_schema=False)
    def page() -> FileResponse:
        return FileResponse(_PAGE)

    @app.get("/status")
    def status() -> dict[str, Any]:
        return player.status()

    @app.post("/{verb}")
    def change(verb: str, request: Request) -> dict[str, Any]:
        query, name = dict(request.query_params), PARAMETERS.get(verb, "")
        if unknown := sorted(set(query) - {name}):
            raise InputError(f"{verb}: parameter {unknown[0]!r}, expected {name or 'none'}")
        control(player, stop, verb, query.get(name, ""))
        return player.status()

    return app


@contextmanager
def served(player: Player, stop: threading.Event, port: int) -> Iterator[str]:
    """Serve the control of a player on a port of this machine, 0 for a free one; yield the URL.

    Raises UnavailableError if the port is taken.
    """
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((HOST, port))
        listening.listen()  # callers wait from now on instead of being refused
    except (OSError, OverflowError) as error:
        listening.close()
        raise UnavailableError(f"HTTP on {HOST}:{port}: {error}; choose another with --http") from error
    config = uvicorn.Config(
        create_app(player, stop), log_config=None, access_log=False, lifespan="off", server_header=False
    )
    logging.getLogger("uvicorn.error").setLevel(logging.WARNING)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, name="http", daemon=True)
    thread.start()
    try:
        yield f"http://{HOST}:{listening.getsockname()[1]}"
    finally:
        server.should_exit = True
        thread.join(_STOP_S)
        listening.close()

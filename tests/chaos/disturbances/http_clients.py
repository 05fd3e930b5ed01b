# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""HTTP clients that are silent, slow, or speak another protocol; others are answered meanwhile."""

from __future__ import annotations

import socket
import ssl
import time
from contextlib import ExitStack, suppress

from cdff_common.clock import monotonic_s
from tests.chaos.disturbances.disturbance import Scene
from tests.chaos.disturbances.intruders import secure_context
from tests.chaos.mission import OPERATOR

_IDLE, _SLOW, _HELD_S = 300, 8, 8.0
#: Longest time to the answer of a health check over a new connection, seconds. The machine can be busy.
_ANSWER_S = 10.0
_PAGE = b"GET /api/v1/products?limit=1000 HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


def hold_idle_sockets(scene: Scene) -> None:
    """Open sockets that send nothing."""
    address = ("127.0.0.1", scene.mission.http_port)
    with ExitStack() as sockets:
        for _ in range(_IDLE):
            with suppress(OSError):  # the server may restart
                sockets.enter_context(socket.create_connection(address, timeout=5))
        _check_health(scene, "idle sockets")
        time.sleep(_HELD_S)
        _check_health(scene, "idle sockets")


def read_slowly(scene: Scene) -> None:
    """Ask for long answers and read them slowly."""
    with ExitStack() as sockets:
        readers = [r for _ in range(_SLOW) if (r := _open(scene, sockets)) is not None]
        for reader in readers:
            with suppress(OSError):
                reader.sendall(_PAGE)
        until_s = monotonic_s() + _HELD_S
        while monotonic_s() < until_s:
            for reader in readers:
                with suppress(OSError):
                    reader.recv(16)
            time.sleep(0.2)
        _check_health(scene, "slow readers")


def send_junk(scene: Scene) -> None:
    """Send random bytes, broken headers and broken bodies."""
    rng = scene.rng
    junk = (
        rng.randbytes(3000),
        b"GET " + b"/" * 100_000 + b" HTTP/1.1\r\n\r\n",
        b"POST /api/v1/products HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000000\r\n\r\n"
        + rng.randbytes(99),
        b"POST /api/v1/products HTTP/1.1\r\nHost: 127.0.0.1\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
        b"GET /api/v1/products?limit=%ff&region=" + b"9" * 3000 + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    )
    with ExitStack() as sockets:
        for body in junk:
            with suppress(OSError):
                plain = socket.create_connection(("127.0.0.1", scene.mission.http_port), timeout=5)
                sockets.enter_context(plain).sendall(body)
            reader = _open(scene, sockets)
            if reader is not None:
                with suppress(OSError):
                    reader.sendall(body)
                    reader.recv(100)
    _check_health(scene, "junk")


def _open(scene: Scene, sockets: ExitStack) -> ssl.SSLSocket | None:
    """Return a connection as the operator; None if the server does not answer."""
    context = secure_context(scene.mission, OPERATOR)
    try:
        plain = sockets.enter_context(
            socket.create_connection(("127.0.0.1", scene.mission.http_port), timeout=5)
        )
        return sockets.enter_context(context.wrap_socket(plain, server_hostname="127.0.0.1"))
    except OSError:
        return None


def _check_health(scene: Scene, what: str) -> None:
    """Check that the server answers a new client in time; repeated, because the DPM may restart."""
    until_s = monotonic_s() + 60.0
    while True:
        start_s = monotonic_s()
        if _is_healthy(scene):
            return
        if start_s > until_s:
            scene.oracle.violate(f"HTTP with {what}: no health check answered within {_ANSWER_S:g} s")
            return
        time.sleep(0.5)


def _is_healthy(scene: Scene) -> bool:
    with ExitStack() as sockets, suppress(OSError):
        connection = _open(scene, sockets)
        if connection is not None:
            connection.settimeout(_ANSWER_S)
            connection.sendall(b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
            return b" 200 " in connection.recv(100)
    return False

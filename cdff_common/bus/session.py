# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Zenoh sessions as this framework uses them: clients of one router, no multicast, shared memory by choice."""

from __future__ import annotations

import json
import os
import threading
import time

import zenoh

from cdff_common.errors import UnavailableError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
#: Lease of a link, ms: a peer that hangs is noticed after this, one that dies at once.
LEASE_MS = 5000
_ATTEMPT_MS = 500
_RETRY = '{"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 1.5}'


def _common(config: zenoh.Config) -> None:
    """Settings that hold for routers and clients."""
    shm_mb = int(os.environ.get("CDFF_SHM_MB", "16"))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("timestamping/enabled", "true")
    config.insert_json5("transport/link/tx/lease", str(LEASE_MS))
    config.insert_json5("transport/shared_memory/enabled", "true" if shm_mb else "false")
    if shm_mb:
        config.insert_json5("transport/shared_memory/transport_optimization/pool_size", str(shm_mb << 20))


def endpoint(connect: str | None = None) -> str:
    """The router to use: the argument, else ``CDFF_CONNECT``, else the loopback default."""
    return connect or os.environ.get("CDFF_CONNECT") or DEFAULT_ENDPOINT


def open_client(connect: str | None, wait_s: float | None, stop: threading.Event | None = None) -> zenoh.Session:
    """Open a client session, trying until the router answers.

    Parameters
    ----------
    connect : str or None
        Endpoint, as ``tcp/127.0.0.1:7447``; None takes ``CDFF_CONNECT`` or the default.
    wait_s : float or None
        How long to try; None for ever.
    stop : threading.Event, optional
        Ends the waiting when it is set.

    Raises
    ------
    UnavailableError
        If no router answers in time.
    """
    zenoh.init_log_from_env_or("error")
    where = endpoint(connect)
    config = zenoh.Config()
    _common(config)
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([where]))
    config.insert_json5("connect/timeout_ms", str(_ATTEMPT_MS))
    config.insert_json5("connect/exit_on_failure", "true")
    config.insert_json5("connect/retry", _RETRY)
    config.insert_json5("queries_default_timeout", "10000")
    deadline = None if wait_s is None else time.monotonic() + wait_s
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            stopped = stop is not None and stop.is_set()
            if stopped or (deadline is not None and time.monotonic() >= deadline):
                raise UnavailableError(
                    f"no Zenoh router answers at {where}: start one with `cdff up`, or set CDFF_CONNECT"
                ) from error
            time.sleep(0.1)


def open_router(listen: str, uplink: str | None = None) -> zenoh.Session:
    """Open a session that routes for others, listening on ``listen`` (as ``tcp/127.0.0.1:7447``).

    With ``uplink``, the endpoint of another router, it is one system with that one whenever it is in contact: the link
    is made as soon as it can be, and again whenever it was lost.

    Raises
    ------
    UnavailableError
        If the endpoint cannot be listened on.
    """
    zenoh.init_log_from_env_or("error")
    config = zenoh.Config()
    _common(config)
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([listen]))
    config.insert_json5("listen/exit_on_failure", "true")
    if uplink:
        config.insert_json5("connect/endpoints", json.dumps([uplink]))
        config.insert_json5("connect/timeout_ms", "-1")  # in the background, for as long as it takes
        config.insert_json5("connect/exit_on_failure", "false")
        config.insert_json5("connect/retry", _RETRY)
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise UnavailableError(f"cannot listen on {listen}: {error}; is another router running?") from error

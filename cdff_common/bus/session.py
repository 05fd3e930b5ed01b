# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Zenoh sessions: clients of one router, no multicast, optional shared memory, TLS for an identity."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Mapping

import zenoh

from cdff_common.bus.identity import ACCESS, VARIABLE, Identity
from cdff_common.errors import ConfigurationError, UnavailableError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
#: Default with an identity. Its certificate is valid for this address.
SECURE_ENDPOINT = "tls/127.0.0.1:7447"
#: Lease of a link, ms: a peer that hangs is detected after this time, one that exits immediately.
LEASE_MS = 5000
#: Time that a droppable message waits for space in the queue of a link before it is dropped, and time for all
#: fragments of one message, µs. Zenoh's defaults of 1 and 50 ms lose sensor samples on a busy processor.
_WAIT_BEFORE_DROP_US = {"wait_before_drop": 100_000, "max_wait_before_drop_fragments": 500_000}
#: Batches of 64 kB in the queues of a link for streams, poses and products: 1 MB passes in one step. With the
#: default of 2, the sender and the thread of the link would wait for each other at every second batch.
_BATCHES = {f"transport/link/tx/queue/size/{name}": 16 for name in ("data_high", "data", "data_low")}
#: Time limit of one attempt to connect.
_ATTEMPT_MS = 500
_RETRY = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 1.5}


def _config(mode: str, settings: Mapping[str, object]) -> zenoh.Config:
    """Return a configuration with the settings common to routers and clients, and ``settings``."""
    shm_mb = int(os.environ.get("CDFF_SHM_MB", "0"))
    common = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        # Headers have stamps; Zenoh would log each message of a machine whose clock differs by 0.5 s.
        "timestamping/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/queue/congestion_control/drop": _WAIT_BEFORE_DROP_US,
        "transport/shared_memory/enabled": shm_mb > 0,
    }
    if shm_mb:
        common["transport/shared_memory/transport_optimization/pool_size"] = shm_mb << 20
    zenoh.init_log_from_env_or("error")
    config = zenoh.Config()
    for key, value in {**common, **settings}.items():
        config.insert_json5(key, json.dumps(value))
    return config


def contact_config(address: str, settings: Mapping[str, object], identity: Identity | None) -> zenoh.Config:
    """Return the configuration of a session between a robot and the ground; with an identity only over TLS.

    Raises
    ------
    ConfigurationError
        If the endpoint and the identity do not fit.
    """
    check_endpoint(address, is_secure=identity is not None)
    secure = {} if identity is None else identity.settings(listens="listen/exit_on_failure" in settings)
    return _config("peer", {**secure, **settings})


def endpoint(connect: str | None = None) -> str:
    """Return the router endpoint: the argument, else ``CDFF_CONNECT``, else the loopback default."""
    default = SECURE_ENDPOINT if os.environ.get(VARIABLE) else DEFAULT_ENDPOINT
    return connect or os.environ.get("CDFF_CONNECT") or default


def check_endpoint(address: str, *, is_secure: bool) -> None:
    """Raise ConfigurationError unless an endpoint is ``tls/…`` with an identity and not without one."""
    if address.startswith("tls/") != is_secure:
        remedy = "use tls/HOST:PORT" if is_secure else f"set {VARIABLE} to a folder of `cdff keys`"
        raise ConfigurationError(
            f"endpoint {address} {'with' if is_secure else 'without'} an identity: expected both TLS and an "
            f"identity, or neither; {remedy}"
        )


def open_client(
    connect: str | None,
    wait_s: float | None,
    stop: threading.Event | None = None,
    identity: Identity | None = None,
    *,
    is_anonymous: bool = False,
) -> zenoh.Session:
    """Open a client session, trying until the router answers.

    Parameters
    ----------
    connect : str or None
        Endpoint, e.g. ``tcp/127.0.0.1:7447``; None for ``CDFF_CONNECT`` or the default.
    wait_s : float or None
        Timeout, seconds; None for no limit.
    stop : threading.Event, optional
        Event that ends the waiting.
    identity : Identity, optional
        Default: that of ``CDFF_IDENTITY``.
    is_anonymous : bool
        Without an ``identity`` show none.

    Raises
    ------
    ConfigurationError
        If the endpoint and the identity do not fit.
    UnavailableError
        If no router answers in time.
    """
    address = endpoint(connect)
    if identity is None and not is_anonymous:
        identity = Identity.of_environment()
    check_endpoint(address, is_secure=identity is not None)
    config = _config(
        "client",
        {
            **({} if identity is None else identity.settings(listens=False)),
            **_BATCHES,
            "connect/endpoints": [address],
            "connect/timeout_ms": _ATTEMPT_MS,
            "connect/exit_on_failure": True,
            "connect/retry": _RETRY,
            "queries_default_timeout": 10_000,
        },
    )
    deadline = None if wait_s is None else time.monotonic() + wait_s
    while True:
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            stopped = stop is not None and stop.is_set()
            if stopped or (deadline is not None and time.monotonic() >= deadline):
                raise UnavailableError(
                    f"no Zenoh router answers at {address}: start one with `cdff up`, or set CDFF_CONNECT"
                    + ("" if identity is None else f"; or it refuses the certificate in {identity.folder}")
                ) from error
            time.sleep(0.1)


def check_access_control(identity: Identity) -> None:
    """Raise ConfigurationError if the access-control list of a router cannot be read, or Zenoh refuses it."""
    try:
        _config("router", {"access_control": identity.access_control()})
    except zenoh.ZError as error:
        raise ConfigurationError(f"{identity.path(ACCESS)}: {error}") from error


def open_router(listen: str, uplink: str | None = None, identity: Identity | None = None) -> zenoh.Session:
    """Open a router session that listens on ``listen``, e.g. ``tcp/127.0.0.1:7447``.

    ``uplink`` is the endpoint of another router. The link to it is established whenever it is reachable, and
    again after each loss of the link. With an identity, links need certificates, and its access-control list
    decides who may send what.

    Raises
    ------
    ConfigurationError
        If an endpoint and the identity do not fit, or it has no access-control list.
    UnavailableError
        If the endpoint cannot be listened on.
    """
    settings: dict[str, object] = {"listen/endpoints": [listen], "listen/exit_on_failure": True, **_BATCHES}
    for address in (listen, uplink):
        if address:
            check_endpoint(address, is_secure=identity is not None)
    if identity is not None:
        settings |= identity.settings(listens=True) | {"access_control": identity.access_control()}
    if uplink:
        settings |= {
            "connect/endpoints": [uplink],
            "connect/timeout_ms": -1,  # in the background, without a limit
            "connect/exit_on_failure": False,
            "connect/retry": _RETRY,
        }
    try:
        return zenoh.open(_config("router", settings))
    except zenoh.ZError as error:
        raise UnavailableError(f"cannot listen on {listen}: {error}; is another router running?") from error

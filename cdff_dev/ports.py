# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Network addresses and TCP ports."""

from __future__ import annotations

import random
import socket

from cdff_common.errors import ConfigurationError, UnavailableError

#: Ports below those that Linux gives to clients, and the number of them that are tried.
_SERVER_PORTS, _TRIES = range(15_000, 32_000), 100


def free_port() -> int:
    """Return a TCP port of the loopback interface that is currently free."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def free_udp_port() -> int:
    """Return a UDP port of the loopback interface that is currently free.

    The system gives it to no client, so that it remains free while the process that uses it restarts.

    Raises
    ------
    UnavailableError
        If no free port was found.
    """
    for port in random.SystemRandom().sample(_SERVER_PORTS, _TRIES):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
            return port
    raise UnavailableError(f"no free UDP port among {_TRIES} in {_SERVER_PORTS}")


def split_address(address: str, what: str = "address") -> tuple[str, int]:
    """Return host and port of ``host:port`` or ``tcp/host:port``.

    Raises ConfigurationError on other forms; ``what`` names the address in the message.
    """
    host, _, port = address.rpartition("/")[2].rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535:
        raise ConfigurationError(f"{what} {address!r}: expected host:port, such as 127.0.0.1:8080")
    return host.strip("[]"), int(port)

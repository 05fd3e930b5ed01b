# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Probes of TCP connections, which find a machine that is switched off or out of reach."""

from __future__ import annotations

import socket

#: A connection without traffic is probed after 30 s, then every 10 s; it ends after 3 probes without answer.
#: By default the system would begin after two hours.
_PROBES = {"TCP_KEEPIDLE": 30, "TCP_KEEPINTVL": 10, "TCP_KEEPCNT": 3}


def probe(sock: socket.socket) -> None:
    """Have the system end a connection within a minute if the other machine does not answer.

    Connections other than those of IPv4 and IPv6 stay as they are.
    """
    if sock.family not in (socket.AF_INET, socket.AF_INET6):  # both programs are on this machine
        return
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for name, value in _PROBES.items():
        sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)

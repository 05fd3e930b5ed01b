# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Free UDP ports."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from cdff_common.errors import UnavailableError
from cdff_dev import ports
from cdff_dev.ports import free_udp_port


def test_a_free_udp_port_is_not_one_of_those_that_the_system_gives_to_clients() -> None:
    lowest = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])
    port = free_udp_port()
    assert port < lowest
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", port))


def test_used_udp_ports_are_not_returned(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        used = server.getsockname()[1]
        monkeypatch.setattr(ports, "_SERVER_PORTS", range(used, used + 1))
        monkeypatch.setattr(ports, "_TRIES", 1)
        with pytest.raises(UnavailableError, match="no free UDP port"):
            free_udp_port()

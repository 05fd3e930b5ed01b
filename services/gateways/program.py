# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The program of a gateway: its common options, and its connections to the bus."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event

from cdff_common.bus import Bus
from cdff_common.cli import add_connect_option
from cdff_common.client import Client
from cdff_common.errors import ConfigurationError
from cdff_common.heartbeat import add_check
from cdff_common.memory import reuse_large_blocks


def add_gateway_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--settings``, ``--robot`` and ``--connect`` to the options of a gateway."""
    parser.add_argument("--settings", required=True, help="YAML file of the topics that may pass")
    parser.add_argument("--robot", help="robot that the settings must name")
    add_connect_option(parser)


def address_of(text: str, default_port: int) -> tuple[str, int]:
    """Return host and port of ``HOST[:PORT]``; raises ConfigurationError if the port is no number."""
    host, _, port = text.partition(":")
    if port and not (port.isdigit() and 0 < int(port) < 1 << 16):
        raise ConfigurationError(f"{text!r}: expected HOST or HOST:PORT, with a port up to 65535")
    return host, int(port) if port else default_port


@contextmanager
def gateway_connections(connect: str | None, service: str, stop: Event) -> Iterator[tuple[Bus, Client]]:
    """Yield a bus, whose threads the heartbeat checks, and a client for requests."""
    reuse_large_blocks()
    with (
        Bus.open(connect, name=service, wait_s=None, stop=stop) as bus,
        Client(connect, name=service) as client,
    ):
        add_check(bus.loops.problem)
        yield bus, client

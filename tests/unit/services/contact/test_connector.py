# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Attempts of the robot to open a session with the ground."""

from __future__ import annotations

import time

import pytest

from cdff_common.bus.contact_session import ContactSession
from cdff_common.errors import ConfigurationError
from cdff_dev.ports import free_udp_port
from services.contact.connector import Connector
from tests.unit.services.contact.test_exchange import wait_until


def poll_until_open(connector: Connector) -> ContactSession:
    """Return the session that is opened first."""
    opened: list[ContactSession] = []

    def is_open() -> bool:
        connector.poll(time.monotonic(), 0.0)
        session = connector.take()
        if session is not None:
            opened.append(session)
        return bool(opened)

    wait_until(is_open)
    return opened[0]


def test_a_session_is_opened_as_soon_as_the_ground_listens() -> None:
    endpoint = f"udp/127.0.0.1:{free_udp_port()}"
    connector = Connector(endpoint)
    connector.poll(time.monotonic(), 0.0)
    assert connector.take() is None
    with ContactSession.listen(endpoint) as ground:
        received: list[bytes] = []
        ground.receive("cdff/test", lambda _, data: received.append(data))
        with poll_until_open(connector) as session:
            wait_until(lambda: session.send("cdff/test", b"packet") or received)
    connector.close()
    assert received[0] == b"packet"


def test_a_session_that_was_opened_before_a_stop_is_not_used() -> None:
    endpoint = f"udp/127.0.0.1:{free_udp_port()}"
    connector = Connector(endpoint)
    with ContactSession.listen(endpoint):
        connector.poll(time.monotonic(), 0.0)
        wait_until(lambda: not connector._opened.empty())
        connector.stop()
        assert connector.take() is None
        connector.close()


def test_an_endpoint_that_does_not_fit_the_identity_is_an_error() -> None:
    connector = Connector(f"tls/127.0.0.1:{free_udp_port()}")

    def poll() -> bool:
        connector.poll(time.monotonic(), 0.0)
        return False

    with pytest.raises(ConfigurationError, match="without an identity"):
        wait_until(poll)
    connector.close()

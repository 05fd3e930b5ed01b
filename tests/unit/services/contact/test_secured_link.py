# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The link of a contact over TLS: identities of the mission exchange packets, others are refused."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

import pytest

from cdff_common.bus import keys
from cdff_common.bus.contact_session import ContactSession
from cdff_common.bus.identity import VARIABLE
from cdff_common.errors import ConfigurationError, UnavailableError
from cdff_dev.ports import free_port
from tests.support.identities import make_identities

DOWN = keys.contact("mana", "down")


@contextmanager
def identity(folder: Path | None) -> Iterator[None]:
    """Use an identity inside the block, or none."""
    with patch.dict("os.environ"):
        os.environ.pop(VARIABLE, None)
        if folder is not None:
            os.environ[VARIABLE] = str(folder)
        yield


def test_robots_of_the_mission_send_their_own_packets_and_others_are_refused(tmp_path: Path) -> None:
    make_identities(tmp_path / "secrets")
    make_identities(tmp_path / "foreign")
    endpoint = f"tls/127.0.0.1:{free_port()}"
    received: list[bytes] = []
    arrived = threading.Event()
    with identity(tmp_path / "secrets" / "ground"):
        ground = ContactSession.listen(endpoint)
    with ground:
        ground.receive(DOWN, lambda _, data: (received.append(data), arrived.set())[1])
        with identity(tmp_path / "secrets" / "mana"), ContactSession.connect(endpoint) as robot:
            for _ in range(100):  # until the subscription is known at the robot
                robot.send(DOWN, b"packet")
                if arrived.wait(0.1):
                    break
            answered = threading.Event()
            robot.receive(keys.contact("mana", "up"), lambda _, data: answered.set())
            for _ in range(100):
                ground.send(keys.contact("mana", "up"), b"answer")
                if answered.wait(0.1):
                    break
        assert received[:1] == [b"packet"]
        assert answered.is_set()
        received.clear()
        own = threading.Event()
        ground.receive(keys.contact("minnie", "down"), lambda _, data: own.set())
        with identity(tmp_path / "secrets" / "minnie"), ContactSession.connect(endpoint) as other:
            for _ in range(100):  # its own packets arrive
                other.send(DOWN, b"forged")
                other.send(keys.contact("minnie", "down"), b"packet")
                if own.wait(0.1):
                    break
        assert own.is_set()
        assert b"forged" not in received
        with identity(tmp_path / "foreign" / "mana"), pytest.raises(UnavailableError, match="link tls/"):
            ContactSession.connect(endpoint)


def test_tls_without_an_identity_and_plain_links_with_one_are_refused(tmp_path: Path) -> None:
    make_identities(tmp_path / "secrets")
    with identity(None), pytest.raises(ConfigurationError, match="without an identity"):
        ContactSession.connect(f"tls/127.0.0.1:{free_port()}")
    with (
        identity(tmp_path / "secrets" / "mana"),
        pytest.raises(ConfigurationError, match="use tls/HOST:PORT"),
    ):
        ContactSession.connect(f"udp/127.0.0.1:{free_port()}")

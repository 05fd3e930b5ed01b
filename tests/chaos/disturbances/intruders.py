# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Intruders: without or with a foreign certificate, on the keys of others, and without a right at HTTP."""

from __future__ import annotations

import http.client
import socket
import ssl
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from cdff_common.bus import keys
from cdff_common.bus.identity import AUTHORITY, CERTIFICATE, KEY
from cdff_dev.ports import split_address
from services.keys.authority import Authority, key_pem, pem
from tests.chaos.disturbances.disturbance import Scene
from tests.chaos.mission import Mission

_REPORTED_S = 40.0


def connect_to_router(scene: Scene) -> None:
    """Connect to the router without a certificate, and with one of another authority."""
    address = split_address(scene.mission.endpoint)
    foreign = scene.mission.folder / "foreign.pem"
    if not foreign.exists():
        authority = Authority.create("foreign", 1)
        foreign.write_bytes(pem(authority.certificate) + key_pem(authority.key))
    for certificate in (None, foreign):
        context = _trusting_context(certificate)
        _repeat_until_reported(scene, "router", lambda c=context: _shake_hands(address, c))


def use_keys_of_another_robot(scene: Scene) -> None:
    """Publish a product of minnie with the identity of mana."""
    key = keys.product("minnie", "troublemaker", "echo")
    mana = scene.mission.bus("mana")
    _repeat_until_reported(scene, "router", lambda: mana.publish(key, b"forged"))


def write_over_http(scene: Scene) -> None:
    """Write over HTTP without a certificate, with an invented key."""

    def attempt() -> None:
        connection = http.client.HTTPSConnection(
            "127.0.0.1", scene.mission.http_port, timeout=5, context=_trusting_context(None)
        )
        connection.request(
            "POST", "/api/v1/products", body=b"{}", headers={"Authorization": "Bearer guessed"}
        )
        status = connection.getresponse().status
        if status < 400:
            scene.oracle.violate(f"an intruder's POST was answered with {status}")
        connection.close()

    _repeat_until_reported(scene, "http", attempt)


def secure_context(mission: Mission, identity: str) -> ssl.SSLContext:
    """Return the TLS settings of a client of the HTTP server with an identity of the mission."""
    folder = mission.secrets / identity
    context = ssl.create_default_context(cafile=str(folder / AUTHORITY))
    context.load_cert_chain(folder / CERTIFICATE, folder / KEY)
    return context


def _trusting_context(certificate: Path | None) -> ssl.SSLContext:
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    if certificate is not None:
        context.load_cert_chain(certificate)
    return context


def _shake_hands(address: tuple[str, int], context: ssl.SSLContext) -> None:
    with socket.create_connection(address, timeout=5) as plain, context.wrap_socket(plain) as secure:
        secure.recv(1)


def _repeat_until_reported(scene: Scene, source: str, attempt: Callable[[], None]) -> None:
    """Repeat an attempt until the alarm is active, at least once: a router that restarts forgets refusals."""

    def is_reported() -> bool:
        with suppress(OSError, http.client.HTTPException):
            attempt()
        return scene.mission.has_alarm("refused_identity", source)

    scene.oracle.expect_alarm("refused_identity", source, is_reported, _REPORTED_S)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Callers with a client certificate: the identities of the bus, with their roles."""

from __future__ import annotations

import asyncio
import json
import logging
import ssl
from collections.abc import Mapping
from typing import Any

from cdff_common.bus.identity import AUTHORITY, CERTIFICATE, KEY, MEMBERS, Identity
from dpm_store.history.events import ROLES, Actor

logger = logging.getLogger(__name__)

#: Field of the state of an ASGI scope with the common name of the caller's certificate.
COMMON_NAME = "certificate_common_name"


def common_name(transport: asyncio.BaseTransport) -> str:
    """Return the common name of the certificate that the TLS handshake has verified; empty without one."""
    secured = transport.get_extra_info("ssl_object")
    subject = () if secured is None else (secured.getpeercert() or {}).get("subject", ())
    return next((value for part in subject for field, value in part if field == "commonName"), "")


def server_options(identity: Identity | None) -> dict[str, Any]:
    """Return the options of uvicorn for TLS with optional client certificates; none without an identity."""
    if identity is None:
        return {}
    return {
        "ssl_certfile": identity.path(CERTIFICATE),
        "ssl_keyfile": identity.path(KEY),
        "ssl_ca_certs": identity.path(AUTHORITY),
        "ssl_cert_reqs": ssl.CERT_OPTIONAL,  # callers with an API key need none
    }


class Members:
    """Accepted certificates, read again when their file changes; none if it cannot be read."""

    def __init__(self, identity: Identity) -> None:
        self._path = identity.folder / MEMBERS
        self._version: tuple[int, int] | None = None
        self._actors: dict[str, Actor] = {}

    def actor(self, scope: Mapping[str, Any]) -> Actor | None:
        """Return the caller of a request; None without a certificate, or with a revoked one."""
        name = scope.get("state", {}).get(COMMON_NAME, "")
        if not name:
            return None
        try:
            status = self._path.stat()
            version = status.st_mtime_ns, status.st_ino
            if version != self._version:
                self._actors = _read(self._path.read_text())
                self._version = version
        except (OSError, ValueError, TypeError) as error:
            logger.error("%s: %s; no certificate is accepted", self._path, error)
            return None
        return self._actors.get(name)


def _read(text: str) -> dict[str, Actor]:
    return {
        common_name: Actor(name, role, "http")
        for common_name, (name, role) in json.loads(text).items()
        if role in ROLES
    }

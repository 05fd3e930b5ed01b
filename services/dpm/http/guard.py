# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Who may talk to the server: known ``Host`` only, no writes from a foreign ``Origin``, keys off loopback, size caps.

The first two keep a web page that an operator has open elsewhere from reaching a server on the same machine (DNS
rebinding, cross-site requests).
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import urlsplit

from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cdff_common.errors import ConfigurationError
from services.dpm.http.problems import problem
from services.dpm.settings import Settings

_SAFE = frozenset({"GET", "HEAD", "OPTIONS"})
_OPEN = frozenset({"/healthz", "/readyz"})
#: Role -> methods it may use.
ROLES: dict[str, frozenset[str]] = {
    "reader": _SAFE,
    "robot": _SAFE | {"POST"},
    "operator": _SAFE | {"POST", "PUT", "PATCH", "DELETE"},
    "admin": _SAFE | {"POST", "PUT", "PATCH", "DELETE"},
}
_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"content-security-policy", b"default-src 'self'; img-src 'self' data:; frame-ancestors 'none'"),
)


class Guard:
    """ASGI middleware in front of everything."""

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self._app = app
        self._hosts = {"localhost", "127.0.0.1", "::1", settings.host.lower(), *(h.lower() for h in settings.hosts)}
        self._keys = None if settings.keys_file is None else read_keys(settings.keys_file)
        self._max_body = settings.max_body_bytes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse, or pass on with the body counted and headers added."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = {k.decode("latin-1"): v.decode("latin-1") for k, v in scope["headers"]}
        refused = self.refusal(scope["method"], scope["path"], headers)
        if refused is not None:
            status, detail = refused
            extra = {"WWW-Authenticate": "Bearer"} if status == 401 else None
            await problem(status, detail, code="DENIED", headers=extra)(scope, receive, send)
            return
        await self._app(scope, _Counted(receive, self._max_body), _with_headers(send))

    def refusal(self, method: str, path: str, headers: Mapping[str, str]) -> tuple[int, str] | None:
        """Status and reason why a request is refused; None where it may go on."""
        host = headers.get("host", "")
        name = _host_name(host)
        if name not in self._hosts:
            return 421, f"Host {host[:80]!r} is not one this server answers to; start it with --host-name"
        origin = headers.get("origin")
        if method not in _SAFE and origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return 403, f"Origin {origin[:80]!r} may not write here"
        if method not in _SAFE and headers.get("sec-fetch-site") == "cross-site":
            return 403, "a page of another site may not write here"
        length = headers.get("content-length", "0")
        if not length.isdigit() or int(length) > self._max_body:
            return 413, f"body of {length[:20]} bytes: expected at most {self._max_body}"
        return self._key_refusal(method, path, headers)

    def _key_refusal(self, method: str, path: str, headers: Mapping[str, str]) -> tuple[int, str] | None:
        if self._keys is None or path in _OPEN:
            return None
        scheme, _, token = headers.get("authorization", "").partition(" ")
        digest = hashlib.sha256(token.strip().encode()).hexdigest()
        role = next((r for known, r in self._keys.items() if hmac.compare_digest(known, digest)), None)
        if scheme.lower() != "bearer" or role is None:
            return 401, "expected Authorization: Bearer with a key that this server knows"
        if method not in ROLES[role]:
            return 403, f"role {role} may not {method}"
        return None


class _Counted:
    """Receives a body and refuses beyond the cap: a body may come without a length."""

    def __init__(self, receive: Receive, cap: int) -> None:
        self._receive = receive
        self._cap = self._left = cap

    async def __call__(self) -> Message:
        """Next message of the request."""
        message = await self._receive()
        self._left -= len(message.get("body", b""))
        if self._left < 0:
            raise HTTPException(413, f"body: expected at most {self._cap} bytes")
        return message


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message["headers"], *_HEADERS]
        await send(message)

    return sending


def _host_name(host: str) -> str:
    """Name in a Host header, its port left out."""
    if host.startswith("["):
        return host[1:].split("]")[0].lower()
    return host.rsplit(":", 1)[0].lower() if ":" in host else host.lower()


def read_keys(path: Path) -> dict[str, str]:
    """Hashed keys and their roles from lines of ``sha256hex role name``; raises ConfigurationError.

    A key is made with ``head -c 32 /dev/urandom | base64`` and hashed with ``sha256sum``.
    """
    try:
        text = path.read_text()
    except OSError as error:
        raise ConfigurationError(f"{path}: {error.strerror}") from error
    keys: dict[str, str] = {}
    for number, line in enumerate(text.splitlines(), 1):
        fields = line.split("#", 1)[0].split()
        if not fields:
            continue
        if len(fields) < 2 or len(fields[0]) != 64 or fields[1] not in ROLES:
            raise ConfigurationError(f"{path}:{number}: expected 'sha256hex role name', role one of {', '.join(ROLES)}")
        keys[fields[0].lower()] = fields[1]
    return keys

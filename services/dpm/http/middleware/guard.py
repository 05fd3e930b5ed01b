# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Access control: known ``Host``, no writes from a foreign ``Origin``, keys and roles, size limits.

The first two prevent DNS rebinding and cross-site requests. Every check precedes the reading of the body.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from urllib.parse import urlsplit

from starlette.concurrency import run_in_threadpool
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from dpm_store.history.events import Actor, acting
from services.dpm.http.middleware.members import Members
from services.dpm.http.middleware.problems import problem
from services.dpm.http.middleware.roles import LOCAL, SAFE, Keys, Rule, rule_for
from services.dpm.operations.refusals import RefusalLog
from services.dpm.settings import Settings

#: Paths without a key: health, the page and the interface description. They hold no data.
_OPEN = frozenset({"/healthz", "/readyz", "/", "/docs", "/openapi.json"})
_OPEN_BELOW = "/static/"
_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"content-security-policy", b"default-src 'self'; img-src 'self' data: blob:; frame-ancestors 'none'"),
)


@dataclass(frozen=True, slots=True)
class Refusal:
    """Status and reason of a refused request."""

    status: int
    detail: str


class Guard:
    """ASGI middleware in front of all routes.

    Parameters
    ----------
    app : ASGIApp
    settings : Settings
    rules : iterable of Rule
        Roles of the routes that change something.
    refusals : RefusalLog
        Log of refused writes.
    """

    def __init__(self, app: ASGIApp, settings: Settings, rules: Iterable[Rule], refusals: RefusalLog) -> None:
        self._app = app
        self._hosts = {
            "localhost",
            "127.0.0.1",
            "::1",
            settings.host.lower(),
            *(h.lower() for h in settings.hosts),
        }
        self._keys = None if settings.keys_file is None else Keys(settings.keys_file)
        self._members = None if settings.identity is None else Members(settings.identity)
        self._max_body = settings.max_body_bytes
        self._origins = _Everything() if "*" in settings.cors_origins else settings.cors_origins
        self._rules = tuple(rules)
        self._refusals = refusals

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse a request, or forward it with its actor and security headers."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = {k.decode("latin-1"): v.decode("latin-1") for k, v in scope["headers"]}
        method, path = scope["method"], scope["path"]
        rule = None if method in SAFE else rule_for(self._rules, method, path)
        actor = self._actor(scope, headers)
        refused = self.refusal(method, path, headers, actor, rule)
        recorder = _StatusRecorder(_with_headers(send))
        if refused is None:
            with acting(actor):
                await self._app(scope, receive, recorder)
        else:
            extra = {"WWW-Authenticate": "Bearer"} if refused.status == 401 else None
            await problem(refused.status, refused.detail, code="DENIED", headers=extra)(
                scope, receive, recorder
            )
        address = (scope.get("client") or ("",))[0]
        if (
            refused is not None
            and refused.status == 401
            and (method not in SAFE or "authorization" in headers)
        ):
            self._refusals.identity_alarm.refuse(f"{method} {path[:200]} from {address}: {refused.detail}")
        is_write = method not in SAFE and (rule is None or rule.changes)
        if is_write and recorder.status >= 400:
            reason = refused.detail if refused is not None else recorder.detail
            await run_in_threadpool(
                self._refusals.enter, actor, f"{method} {path}", recorder.status, reason, address
            )

    def refusal(
        self, method: str, path: str, headers: Mapping[str, str], actor: Actor | None, rule: Rule | None
    ) -> Refusal | None:
        """Return the refusal of a request; None if it is admitted."""
        host = headers.get("host", "")
        if _host_name(host) not in self._hosts:
            return Refusal(
                421, f"Host {host[:80]!r} is not one this server answers to; add it to CDFF_HTTP_HOSTS"
            )
        origin = headers.get("origin")
        changes = method not in SAFE and (rule is None or rule.changes or origin not in self._origins)
        if changes and origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return Refusal(403, f"Origin {origin[:80]!r} may not write here")
        if changes and headers.get("sec-fetch-site") == "cross-site":
            return Refusal(403, "a page of another site may not write here")
        if actor is None and not (method in SAFE and (path in _OPEN or path.startswith(_OPEN_BELOW))):
            return Refusal(401, "expected a known key (Authorization: Bearer) or client certificate")
        if actor is not None and rule is not None and (rule.roles is None or actor.role not in rule.roles):
            return Refusal(403, f"role {actor.role} may not {method} {rule.path}")
        length = headers.get("content-length", "0")
        if not length.isdigit() or int(length) > self._max_body:
            return Refusal(413, f"body of {length[:20]} bytes: expected at most {self._max_body}")
        return None

    def _actor(self, scope: Scope, headers: Mapping[str, str]) -> Actor | None:
        """Return the actor of the key, else of the client certificate; None if neither is known."""
        if self._keys is None and self._members is None:
            return LOCAL
        actor = None if self._keys is None else self._keys.actor(headers.get("authorization", ""))
        if actor is None and self._members is not None:
            actor = self._members.actor(scope)
        return actor


class _Everything:
    """Container of all origins."""

    def __contains__(self, _: object) -> bool:
        return True


class _StatusRecorder:
    """Forwards an answer and records its status and, of a problem document, the detail."""

    def __init__(self, send: Send) -> None:
        self._send = send
        self.status = 0
        self._body = b""

    async def __call__(self, message: Message) -> None:
        """Forward one message."""
        if message["type"] == "http.response.start":
            self.status = message["status"]
        elif self.status >= 400 and not self._body:
            self._body = message.get("body", b"")[:4096]
        await self._send(message)

    @property
    def detail(self) -> str:
        """Reason of a refusal."""
        try:
            return str(json.loads(self._body)["detail"])
        except (ValueError, KeyError, TypeError):
            return f"answered with {self.status}"


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message["headers"], *_HEADERS]
        await send(message)

    return sending


def _host_name(host: str) -> str:
    """Return the name in a Host header, without the port."""
    if host.startswith("["):
        return host[1:].split("]")[0].lower()
    return host.rsplit(":", 1)[0].lower() if ":" in host else host.lower()

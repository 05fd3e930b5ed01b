# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conditional GET (RFC 9110 §13) and HEAD for everything: JSON answers get a weak ETag of what they hold."""

from __future__ import annotations

import hashlib

from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.dpm.parameters import revision_of

#: Answered as GET without a body; a stream of events has no end that a HEAD could wait for.
_NO_HEAD = frozenset({"/api/v1/events"})
_JSON = ("application/json", "application/geo+json")
#: Larger answers are passed on as they come.
_MOST_BYTES = 8 << 20


def matches(if_none_match: str | None, etag: str) -> bool:
    """Whether a caller has what an ETag names: ``If-None-Match`` compares weakly and may list several."""
    if if_none_match is None:
        return False
    known = {part.strip().removeprefix("W/") for part in if_none_match.split(",")}
    return "*" in known or etag.removeprefix("W/") in known


def required_revision(if_match: str) -> int | None:
    """The revision that ``If-Match`` wants, None for any; it compares strongly (RFC 9110 §13.1.1).

    Raises
    ------
    HTTPException
        412 for a weak tag: it never matches.
    InputError
        If it names no revision.
    """
    if if_match.strip().startswith("W/"):
        raise HTTPException(412, f'If-Match: {if_match[:40]} is weak and never matches: send the ETag as "r3"')
    return revision_of(if_match)


class Conditional:
    """ASGI middleware."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer HEAD as GET, and 304 where the caller has it already."""
        if scope["type"] != "http" or scope["method"] not in ("GET", "HEAD") or scope["path"] in _NO_HEAD:
            await self._app(scope, receive, send)
            return
        given = next((v.decode("latin-1") for k, v in scope["headers"] if k == b"if-none-match"), None)
        answer = _Answer(send, given, body_wanted=scope["method"] == "GET")
        await self._app(scope | {"method": "GET"}, receive, answer.send)


class _Answer:
    def __init__(self, send: Send, if_none_match: str | None, *, body_wanted: bool) -> None:
        self._send = send
        self._given = if_none_match
        self._body_wanted = body_wanted
        self._start: Message | None = None
        self._parts: list[bytes] = []
        self._size = 0

    async def send(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(raw=message["headers"])
            plain = message["status"] == 200 and headers.get("content-type", "").startswith(_JSON)
            small = int(headers.get("content-length", _MOST_BYTES + 1)) <= _MOST_BYTES
            if plain and small:
                self._start = message
            else:
                await self._send(message)
            return
        if self._start is None:
            body = message.get("body", b"") if self._body_wanted else b""
            await self._send({**message, "body": body})
            return
        self._parts.append(message.get("body", b""))
        if not message.get("more_body", False):
            await self._finish(self._start, b"".join(self._parts))

    async def _finish(self, start: Message, body: bytes) -> None:
        headers = MutableHeaders(raw=list(start["headers"]))
        etag = headers.get("etag") or f'W/"{hashlib.blake2b(body, digest_size=12).hexdigest()}"'
        headers["ETag"] = etag
        headers.setdefault("Cache-Control", "private, no-cache")
        if matches(self._given, etag):
            del headers["content-length"]
            del headers["content-type"]
            await self._send({**start, "status": 304, "headers": headers.raw})
            body = b""
        else:
            await self._send({**start, "headers": headers.raw})
        await self._send({"type": "http.response.body", "body": body if self._body_wanted else b""})

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conditional GET (RFC 9110 §13) and HEAD for everything: JSON answers get a weak ETag of their content, and
answers of text are compressed.
"""

from __future__ import annotations

import hashlib

from starlette.concurrency import run_in_threadpool
from starlette.datastructures import MutableHeaders
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from services.dpm.http.middleware.compression import (
    CODINGS,
    MOST_AT_ONCE_BYTES,
    SMALLEST_BYTES,
    coding_for,
    is_compressible,
)
from services.dpm.queries.bodies import parse_revision

#: Paths of endless streams, which do not answer HEAD.
_NO_HEAD = frozenset({"/api/v1/events"})
#: Paths of searches with POST, which change nothing.
_SEARCHES = frozenset({"/stac/search"})
_JSON = (
    "application/json",
    "application/geo+json",
    "application/vnd.oai.openapi+json",
    "application/schema+json",
)
#: Largest answer with an ETag, bytes.
_MAX_BYTES = 8 << 20


def matches(if_none_match: str | None, etag: str) -> bool:
    """Return True if ``If-None-Match`` lists an ETag, compared weakly."""
    if if_none_match is None:
        return False
    known = {part.strip().removeprefix("W/") for part in if_none_match.split(",")}
    return "*" in known or etag.removeprefix("W/") in known


def required_revision(if_match: str) -> int | None:
    """Return the revision in ``If-Match``, None for any; weak tags never match (RFC 9110 §13.1.1).

    Raises
    ------
    HTTPException
        412 for a weak tag.
    InputError
        If it states no revision.
    """
    if if_match.strip().startswith("W/"):
        raise HTTPException(
            412, f'If-Match: {if_match[:40]} is weak and never matches: send the ETag as "r3"'
        )
    return parse_revision(if_match)


class Conditional:
    """ASGI middleware."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer HEAD like GET without a body, and 304 if the caller has the current content."""
        is_search = scope["type"] == "http" and scope["method"] == "POST" and scope["path"] in _SEARCHES
        if scope["type"] != "http" or scope["path"] in _NO_HEAD:
            await self._app(scope, receive, send)
            return
        if scope["method"] not in ("GET", "HEAD") and not is_search:
            await self._app(scope, receive, send)
            return
        if_none_match = next(
            (v.decode("latin-1") for k, v in scope["headers"] if k == b"if-none-match"), None
        )
        accepted = ",".join(v.decode("latin-1") for k, v in scope["headers"] if k == b"accept-encoding")
        answer = _Answer(send, if_none_match, accepted, sends_body=scope["method"] != "HEAD")
        method = scope["method"] if is_search else "GET"
        await self._app({**scope, "method": method}, receive, answer.send)


class _Answer:
    def __init__(self, send: Send, if_none_match: str | None, accepted: str, *, sends_body: bool) -> None:
        self._send = send
        self._coding = coding_for(accepted)
        self._if_none_match = if_none_match
        self._sends_body = sends_body
        self._start: Message | None = None
        self._parts: list[bytes] = []
        self._is_tagged = False

    async def send(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(raw=message["headers"])
            content_type = headers.get("content-type", "")
            self._is_tagged = content_type.startswith(_JSON)
            plain = message["status"] == 200 and (self._is_tagged or is_compressible(content_type))
            small = int(headers.get("content-length", _MAX_BYTES + 1)) <= _MAX_BYTES
            if plain and small:
                self._start = message
            else:
                await self._send(message)
            return
        if self._start is None:
            body = message.get("body", b"") if self._sends_body else b""
            await self._send({**message, "body": body})
            return
        self._parts.append(message.get("body", b""))
        if not message.get("more_body", False):
            await self._finish(self._start, b"".join(self._parts))

    async def _finish(self, start: Message, body: bytes) -> None:
        headers = MutableHeaders(raw=list(start["headers"]))
        etag = headers.get("etag")
        if etag is None and self._is_tagged:
            etag = f'W/"{hashlib.blake2b(body, digest_size=12).hexdigest()}"'
            headers["ETag"] = etag
        headers.setdefault("Cache-Control", "private, no-cache")
        if etag is not None and matches(self._if_none_match, etag):
            del headers["content-length"]
            del headers["content-type"]
            await self._send({**start, "status": 304, "headers": headers.raw})
            await self._send({"type": "http.response.body", "body": b""})
            return
        # a strong ETag is that of the body without a coding
        if len(body) >= SMALLEST_BYTES and (etag is None or etag.startswith("W/")):
            headers.add_vary_header("Accept-Encoding")
            if self._coding is not None:
                compress = CODINGS[self._coding]
                large = len(body) > MOST_AT_ONCE_BYTES
                body = await run_in_threadpool(compress, body) if large else compress(body)
                headers["Content-Encoding"] = self._coding
                headers["Content-Length"] = str(len(body))
        await self._send({**start, "headers": headers.raw})
        await self._send({"type": "http.response.body", "body": body if self._sends_body else b""})

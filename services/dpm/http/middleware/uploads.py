# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reception of request bodies: with deadlines, on disk, within a bound of all bodies together.

A route runs when its body is complete, so that slow, broken and waiting uploads take no memory.
"""

from __future__ import annotations

import asyncio
import logging
import tempfile
from collections.abc import AsyncIterator

from starlette.concurrency import run_in_threadpool
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from cdff_common.errors import CdffError, OverloadedError, StorageError
from dpm_store import Store
from services.dpm.http.middleware.problems import problem, problem_of
from services.dpm.http.middleware.roles import SAFE
from services.dpm.operations.work_budget import WorkBudget

logger = logging.getLogger(__name__)

#: Largest body that is kept in memory, bytes.
MEMORY_BYTES = 256 << 10
#: Sum of all bodies on disk, in multiples of the largest body.
BODIES = 4
#: Longest pause in a body, seconds, and slowest mean rate after it, bytes per second.
PAUSE_S, SLOWEST_BYTES_S = 20.0, 2000.0
#: Memory for the processing of a body, in multiples of its size.
_COPIES = 3
_RETRY_S = 5.0
_TOO_LARGE = "INVALID_ARGUMENT"


class BodyTooLargeError(Exception):
    """Body beyond the limit of one body."""


class DisconnectedError(Exception):
    """End of the connection before the end of the body."""


class Uploads:
    """ASGI middleware between access control and routes."""

    def __init__(self, app: ASGIApp, store: Store, budget: WorkBudget, max_body_bytes: int) -> None:
        self._app = app
        self._store = store
        self._budget = budget
        self._max_body_bytes = max_body_bytes
        self._on_disk_bytes = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Receive the body, then forward the request with it."""
        if scope["type"] != "http" or scope["method"] in SAFE:
            await self._app(scope, receive, send)
            return
        refusal: Response
        try:
            received = _Body(await self._body(receive), receive)
        except DisconnectedError:
            logger.info("upload to %s broken off", scope["path"])
            return
        except TimeoutError:
            refusal = problem(
                408, f"body: expected no pause of {PAUSE_S:g} s and {SLOWEST_BYTES_S:g} bytes/s"
            )
        except BodyTooLargeError:
            refusal = problem(413, f"body: expected at most {self._max_body_bytes} bytes", code=_TOO_LARGE)
        except CdffError as error:
            refusal = problem_of(error)
        else:
            await self._app(scope, received, send)
            return
        await refusal(scope, receive, send)

    async def _body(self, receive: Receive) -> bytes:
        """Return the complete body of a request; a large body is charged to the work budget."""
        reserved = size = 0
        try:
            with tempfile.SpooledTemporaryFile(MEMORY_BYTES, dir=str(self._store.directory)) as file:
                async for part in _parts(receive):
                    size += len(part)
                    if size > self._max_body_bytes:
                        raise BodyTooLargeError
                    if size > MEMORY_BYTES:
                        self._reserve(size - reserved)
                        reserved = size
                    await self._write(file, part, size)
                file.seek(0)
                if size <= MEMORY_BYTES:
                    return file.read()
                await run_in_threadpool(self._budget.charge, _COPIES * size)
                return await run_in_threadpool(file.read)
        finally:
            self._on_disk_bytes -= reserved

    def _reserve(self, size: int) -> None:
        """Count bytes of a body on disk; raises OverloadedError beyond the bound of all bodies."""
        bound = BODIES * self._max_body_bytes
        if self._on_disk_bytes + size > bound:
            raise OverloadedError(f"bodies of more than {bound} bytes at once", _RETRY_S)
        self._on_disk_bytes += size

    async def _write(self, file: tempfile.SpooledTemporaryFile[bytes], part: bytes, size: int) -> None:
        """Append a part of a body; raises StorageError if the disk is full."""
        if size <= MEMORY_BYTES:
            file.write(part)
            return
        self._store.disk_space.admit(len(part))
        try:
            await run_in_threadpool(file.write, part)
        except OSError as error:
            raise StorageError(f"body of {size} bytes not received: {error.strerror}") from error


class _Body:
    """Receive function that returns a complete body, then the messages that follow it."""

    def __init__(self, body: bytes, receive: Receive) -> None:
        self._message: Message | None = {"type": "http.request", "body": body, "more_body": False}
        self._receive = receive

    async def __call__(self) -> Message:
        """Return the next message."""
        message, self._message = self._message, None
        return await self._receive() if message is None else message


async def _parts(receive: Receive) -> AsyncIterator[bytes]:
    """Yield the parts of a body; raises TimeoutError if they arrive too slowly."""
    loop = asyncio.get_running_loop()
    start_s, received = loop.time(), 0
    while True:
        latest_s = start_s + PAUSE_S + received / SLOWEST_BYTES_S
        async with asyncio.timeout_at(min(loop.time() + PAUSE_S, latest_s)):
            message = await receive()
        if message["type"] == "http.disconnect":
            raise DisconnectedError
        part = message.get("body", b"")
        received += len(part)
        yield part
        if not message.get("more_body", False):
            return

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bodies of answers: large ones are read from disk in parts, so that slow readers take no memory."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO

from fastapi import Response
from fastapi.responses import StreamingResponse
from starlette.background import BackgroundTask

from dpm_store import ProductRecord
from services.dpm.http.context import Context

logger = logging.getLogger(__name__)

#: Largest body that is kept in memory, and size of the parts in which larger ones are sent, bytes.
MEMORY_BYTES = 1 << 20
_PART_BYTES = 1 << 18


def body_response(
    context: Context, data: bytes, media_type: str, headers: Mapping[str, str], status: int = 200
) -> Response:
    """Return an answer with bytes; large ones are moved to an unnamed file, unless the disk is full."""
    if len(data) > MEMORY_BYTES:
        try:
            file = _file_of(data, context.dpm.store.directory)
        except OSError as error:
            logger.warning("an answer stays in memory: %s", error.strerror)
        else:
            context.dpm.budget.keep(0)
            headers = {**headers, "Content-Length": str(len(data))}
            return StreamingResponse(
                _parts(file, len(data)), status, headers, media_type, background=BackgroundTask(file.close)
            )
    context.dpm.budget.keep(len(data))
    return Response(data, status, dict(headers), media_type)


def opened_response(
    context: Context,
    file: IO[bytes],
    offset: int,
    size: int,
    media_type: str,
    headers: Mapping[str, str],
    is_part: bool,
) -> Response:
    """Return a part of an open file, which is closed after the answer."""
    status = 206 if is_part else 200
    file.seek(offset)
    if size <= MEMORY_BYTES:
        with file:
            data = file.read(size)
        context.dpm.budget.keep(len(data))
        return Response(data, status, dict(headers), media_type)
    context.dpm.budget.keep(0)
    headers = {**headers, "Content-Length": str(size)}
    background = BackgroundTask(file.close)
    return StreamingResponse(_parts(file, size), status, headers, media_type, background=background)


def stored_response(
    context: Context, record: ProductRecord, offset: int, size: int, status: int, headers: Mapping[str, str]
) -> Response:
    """Return a part of a stored payload; a large one is checked before its first byte is sent."""
    store, media_type = context.dpm.store, "application/octet-stream"
    if size <= MEMORY_BYTES:
        context.dpm.budget.charge(2 * size)
        return Response(store.payload(record.id, offset, size), status, dict(headers), media_type)

    def parts() -> Iterator[bytes]:
        for first in range(offset, offset + size, MEMORY_BYTES):
            yield store.payload(record.id, first, min(MEMORY_BYTES, offset + size - first))

    for _ in parts():  # a corrupt payload raises StorageError
        pass
    headers = {**headers, "Content-Length": str(size)}
    return StreamingResponse(parts(), status, headers, media_type)


def _file_of(data: bytes, directory: Path) -> IO[bytes]:
    """Return an unnamed file with bytes, at its start."""
    file = tempfile.TemporaryFile(dir=directory)  # noqa: SIM115  # the answer closes it
    file.write(data)
    file.seek(0)
    return file


def _parts(file: IO[bytes], size: int) -> Iterator[bytes]:
    """Yield the next ``size`` bytes of a file in parts."""
    while size > 0 and (part := file.read(min(_PART_BYTES, size))):
        size -= len(part)
        yield part

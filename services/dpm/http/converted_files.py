# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Answers with converted payloads: as a file of the cache, whole or in part, or from memory."""

from __future__ import annotations

import hashlib
import logging
import re
from collections.abc import Callable, Mapping

from fastapi import Response
from starlette.exceptions import HTTPException

from cdff_common.geodesy import Georeference
from dpm_store import ProductRecord
from services.dpm.http.bodies import body_response, opened_response
from services.dpm.http.context import Context
from services.dpm.http.middleware.ranges import parse_range
from services.dpm.rendering.convert import Converted

logger = logging.getLogger(__name__)


def converted_response(
    context: Context,
    key: str,
    converted: Callable[[], Converted],
    name: str,
    range_header: str | None,
    headers: Mapping[str, str],
) -> Response:
    """Return a converted payload, or the part in ``Range``; from memory if the disk is full."""
    try:
        cached = context.dpm.conversions.open(key, converted)
    except OSError as error:
        logger.warning("a converted payload stays in memory: %s", error.strerror)
        return file_response(context, converted(), name, headers)
    try:
        part = parse_range(range_header, cached.size)
    except HTTPException:
        cached.file.close()
        raise
    first, last = part or (0, cached.size - 1)
    named = file_headers(cached.encoding, cached.suffix, name) | {**headers, "Accept-Ranges": "bytes"}
    if part is not None:
        named["Content-Range"] = f"bytes {first}-{last}/{cached.size}"
    return opened_response(
        context, cached.file, first, last - first + 1, media_type_of(cached.encoding), named, part is not None
    )


def converted_name(
    record: ProductRecord, format_name: str, as_type: str | None, place: Georeference | None
) -> str:
    """Return the name of a conversion in an ETag, in characters that a header may hold."""
    placed = "" if place is None else hashlib.blake2b(repr(place).encode(), digest_size=8).hexdigest()
    return re.sub(r"[^A-Za-z0-9_]", "-", f"{record.sha256[:32]}-{format_name}-{as_type or ''}-{placed}")


def file_response(
    context: Context, body: Converted, name: str, headers: Mapping[str, str] | None = None
) -> Response:
    """Return bytes as a file named after the product."""
    named = file_headers(body.encoding, body.suffix, name)
    return body_response(context, body.data, media_type_of(body.encoding), {**named, **(headers or {})})


def file_headers(encoding: str, suffix: str, name: str) -> dict[str, str]:
    """Return the headers of a file named after the product."""
    return {"Content-Disposition": f'inline; filename="{name}.{suffix}"', "CDFF-Encoding": encoding}


def media_type_of(encoding: str) -> str:
    """Return the media type of an encoding."""
    return encoding if "vnd.cdff" not in encoding else "application/octet-stream"

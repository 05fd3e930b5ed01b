# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors as RFC 9457 problem documents, with the HTTP status of ``cdff_common.errors``."""

from __future__ import annotations

import logging
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from cdff_common.contract.parameters import validation_message
from cdff_common.errors import CdffError, ConflictError, OverloadedError, http_status, rpc_code

logger = logging.getLogger(__name__)

MEDIA_TYPE = "application/problem+json"
#: Content of all error answers, which the OpenAPI document describes once.
_BODY = {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}}
RESPONSES: dict[int | str, dict[str, Any]] = {
    "4XX": {"description": "Refused, with a problem document (RFC 9457)", "content": _BODY},
    "5XX": {"description": "Not available, with a problem document (RFC 9457)", "content": _BODY},
}
#: Paths with status 400 for unknown or malformed parameters (OGC 17-069r4 §7.9, STAC API).
_STANDARD = ("/ogc", "/stac")


#: Codes of errors that HTTP itself raises; others are INVALID_ARGUMENT below 500, else UNAVAILABLE.
_CODES = {401: "DENIED", 403: "DENIED", 404: "NOT_FOUND", 409: "CONFLICT", 412: "CONFLICT", 500: "INTERNAL"}


def problem(
    status: int, detail: str, *, code: str = "", headers: dict[str, str] | None = None
) -> JSONResponse:
    """Return a problem document."""
    body: dict[str, Any] = {
        "type": "about:blank",
        "title": HTTPStatus(status).phrase,
        "status": status,
        "detail": detail,
    }
    return JSONResponse(body | ({"code": code} if code else {}), status, headers, MEDIA_TYPE)


def install(app: FastAPI) -> None:
    """Register handlers that answer every error of an application with a problem document."""
    app.add_exception_handler(CdffError, _cdff_error)
    app.add_exception_handler(RequestValidationError, _invalid)
    app.add_exception_handler(HTTPException, _http)
    app.add_exception_handler(Exception, _unknown)


def problem_of(error: CdffError, status: int | None = None) -> JSONResponse:
    """Return the problem document of an error, by default with the status of its class."""
    headers = {"Retry-After": f"{error.retry_after_s:.0f}"} if isinstance(error, OverloadedError) else None
    code = "CONFLICT" if isinstance(error, ConflictError) else rpc_code(error)[0]
    return problem(status or http_status(error), str(error), code=code, headers=headers)


async def _cdff_error(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, CdffError)
    return problem_of(error, _invalid_status(request) if http_status(error) == 422 else None)


async def _invalid(request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, RequestValidationError)
    detail = validation_message(error.errors()[0])
    return problem(_invalid_status(request), detail, code="INVALID_ARGUMENT")


async def _http(_request: Request, error: Exception) -> JSONResponse:
    assert isinstance(error, HTTPException)
    status = error.status_code
    code = _CODES.get(status, "INVALID_ARGUMENT" if status < 500 else "UNAVAILABLE")
    return problem(status, str(error.detail), code=code, headers=dict(error.headers or {}))


async def _unknown(request: Request, error: Exception) -> JSONResponse:
    logger.error("%s %s failed", request.method, request.scope["path"], exc_info=error)
    return problem(500, "unexpected error; see the log of the DPM", code="INTERNAL")


def _invalid_status(request: Request) -> int:
    return 400 if request.scope["path"].startswith(_STANDARD) else 422

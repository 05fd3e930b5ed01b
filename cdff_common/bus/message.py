# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What travels on the bus: messages, requests, replies, parameters and errors."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import quote, unquote_to_bytes

import msgpack

from cdff_common.errors import ERROR_OF_CODE, CdffError, CodecError, InputError, OverloadedError, rpc_code

_MAX_PARAMETERS = 64
_MAX_MAP_BYTES = 64 << 20
_REQUEST_ID = re.compile(r"(?:^|;)request=([^;]{1,200})")


@dataclass(frozen=True, slots=True)
class Message:
    """A published sample: key, payload, encoding string, attachment bytes."""

    key: str
    payload: bytes
    encoding: str
    attachment: bytes


@dataclass(frozen=True, slots=True)
class Request:
    """A call: key, decoded parameters, payload, encoding string, attachment bytes."""

    key: str
    parameters: Mapping[str, str]
    payload: bytes
    encoding: str
    attachment: bytes

    @property
    def scope(self) -> str:
        """Robot id or ``ground``: whom the call was addressed to."""
        return self.key.split("/")[2]

    def body(self) -> Any:
        """The payload as MessagePack; raises CodecError."""
        return unpack(self.payload)

    def check_parameters(self, *known: str) -> None:
        """Refuse parameters other than ``known`` and ``request``; raises InputError naming the first."""
        unknown = sorted(set(self.parameters) - {*known, "request"})
        if unknown:
            raise InputError(f"{self.key}: unknown parameter {unknown[0]!r}; known are {', '.join(known) or 'none'}")


@dataclass(frozen=True, slots=True)
class Reply:
    """An answer: payload, encoding string, attachment map. ``kind`` and ``final`` are in the attachment."""

    payload: bytes = b""
    encoding: str = ""
    attachment: Mapping[str, Any] = field(default_factory=dict)
    key: str = ""

    @classmethod
    def of(cls, body: Any, **attachment: Any) -> Reply:
        """A reply whose payload is a MessagePack body."""
        return cls(pack(body), "application/msgpack", attachment)

    @property
    def final(self) -> bool:
        """Whether no other reply follows."""
        return bool(self.attachment.get("final", True))

    def body(self) -> Any:
        """The payload as MessagePack; raises CodecError."""
        return unpack(self.payload)


def pack(body: Any) -> bytes:
    """MessagePack bytes of plain data."""
    return bytes(msgpack.packb(body))


def unpack(data: bytes) -> Any:
    """Plain data of MessagePack bytes; raises CodecError on anything else."""
    if len(data) > _MAX_MAP_BYTES:
        raise CodecError(f"MessagePack of {len(data)} bytes: expected at most {_MAX_MAP_BYTES}")
    try:
        return msgpack.unpackb(data, strict_map_key=False)
    except (ValueError, msgpack.UnpackException, msgpack.ExtraData, RecursionError) as error:
        raise CodecError(f"{len(data)} bytes that are not MessagePack: {error}") from error


def parse_parameters(text: str) -> dict[str, str]:
    """Parse ``a=1;b=2`` with percent-encoded UTF-8 values.

    Raises
    ------
    InputError
        On a repeated or empty name, too many parameters, or a value that is not UTF-8.
    """
    parameters: dict[str, str] = {}
    parts = [p for p in text.split(";") if p]
    if len(parts) > _MAX_PARAMETERS:
        raise InputError(f"{len(parts)} parameters: expected at most {_MAX_PARAMETERS}")
    for part in parts:
        name, _, value = part.partition("=")
        if not name:
            raise InputError(f"parameter {part!r} has no name")
        if name in parameters:
            raise InputError(f"parameter {name!r} is repeated")
        try:
            parameters[name] = unquote_to_bytes(value).decode("utf-8")
        except UnicodeDecodeError as error:
            raise InputError(f"parameter {name}={value!r}: not percent-encoded UTF-8") from error
    return parameters


def format_parameters(parameters: Mapping[str, object]) -> str:
    """Inverse of ``parse_parameters``; ``, : / -`` stay bare."""
    return ";".join(f"{name}={quote(str(value), safe=',:/-')}" for name, value in parameters.items())


def request_id_of(text: str) -> str:
    """The id that parameters name, empty without one, even where they are otherwise wrong."""
    found = _REQUEST_ID.search(text)
    return unquote_to_bytes(found[1]).decode("utf-8", "replace") if found else ""


def asked_of(text: str) -> dict[str, str]:
    """Parameters as they came, for an error to repeat, even where they are wrong."""
    named = (part.partition("=") for part in text.split(";")[:_MAX_PARAMETERS] if part)
    return {name: unquote_to_bytes(value).decode("utf-8", "replace") for name, _, value in named}


def error_body(error: BaseException, request: str = "", asked: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """``{code, retriable, detail, request, asked}`` of an error, with ``retry_after_s`` where it is known.

    ``request`` is the caller's name for it; without one, that which the error carries. ``asked`` is what was asked: as
    it came, or as it was understood where the error carries that.
    """
    code, retriable = rpc_code(error)
    detail = str(error) if isinstance(error, CdffError) else f"{type(error).__name__}: {error}"
    named = request or getattr(error, "request", "")
    body: dict[str, Any] = {"code": code, "retriable": retriable, "detail": detail, "request": named}
    body["asked"] = dict(getattr(error, "asked", None) or asked or {})
    if isinstance(error, OverloadedError):
        body["retry_after_s"] = error.retry_after_s
    return body


def error_of(body: Any) -> CdffError:
    """The exception a client raises for an error body."""
    if not isinstance(body, dict) or "code" not in body:
        return CdffError(f"malformed error reply {body!r}")
    cls = ERROR_OF_CODE.get(str(body["code"]), CdffError)
    detail = str(body.get("detail", ""))
    error = OverloadedError(detail, float(body.get("retry_after_s", 1.0))) if cls is OverloadedError else cls(detail)
    error.retriable = bool(body.get("retriable", False))
    error.request, error.asked = str(body.get("request", "")), body.get("asked")
    return error

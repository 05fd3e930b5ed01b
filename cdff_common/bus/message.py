# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Data types of the bus: messages, requests, replies, parameters and error bodies."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import quote, unquote_to_bytes

import msgpack

from cdff_common import tracing
from cdff_common.errors import (
    ERROR_OF_CODE,
    CdffError,
    CodecError,
    InputError,
    StorageError,
    UnavailableError,
    public_text,
    rpc_code,
)

logger = logging.getLogger(__name__)

#: Largest number of parameters of a selector, and size of a MessagePack map, in bytes.
_MAX_PARAMETERS = 64
_MAX_MAP_BYTES = 64 << 20
#: Largest encoding string and key, bytes. Zenoh cannot send longer encodings, or keys beyond about 65 kB, and
#: its session is unusable after the attempt.
_MAX_ENCODING_BYTES, _MAX_KEY_BYTES = 255, 4096


def encoding_argument(encoding: str) -> str | None:
    """Return an encoding string as Zenoh takes it, None for an empty one.

    Raises
    ------
    InputError
        If it is too long to be sent.
    """
    _check_size("encoding", encoding, _MAX_ENCODING_BYTES)
    return encoding or None


def key_argument(key: str) -> str:
    """Return a key that can be sent.

    Raises
    ------
    InputError
        If it is empty or too long.
    """
    if not key:
        raise InputError("key: empty, expected chunks such as cdff/@v1/mana/event/note")
    _check_size("key", key, _MAX_KEY_BYTES)
    return key


def _check_size(subject: str, text: str, limit: int) -> None:
    try:
        size = len(text.encode())
    except UnicodeEncodeError as error:
        raise InputError(
            f"{subject} {text[:40]!r}: {error}; expected text that UTF-8 can represent"
        ) from error
    if size > limit:
        raise InputError(f"{subject} {text[:40]!r}: {size} bytes, expected at most {limit}")


@dataclass(frozen=True, slots=True)
class Message:
    """A published sample with its key, payload, encoding and attachment."""

    key: str
    payload: bytes
    encoding: str
    attachment: bytes


@dataclass(frozen=True, slots=True)
class Request:
    """Call: key, decoded parameters, payload, encoding string, attachment bytes."""

    key: str
    parameters: Mapping[str, str]
    payload: bytes
    encoding: str
    attachment: bytes

    @property
    def scope(self) -> str:
        """Addressed robot id, or ``ground``."""
        return self.key.split("/")[2]

    def body(self) -> Any:
        """Return the payload decoded as MessagePack; raises CodecError."""
        return unpack(self.payload)

    def check_parameters(self, *known: str) -> None:
        """Refuse parameters other than ``known`` and ``request``; raises InputError naming the first."""
        unknown = sorted(set(self.parameters) - {"request", *known})
        if unknown:
            expected = " or ".join(known) or "none"
            raise InputError(f"{self.key}: unknown parameter {unknown[0]!r}; expected {expected}")

    def check_no_parameters(self) -> None:
        """Refuse parameters other than ``request``; raises InputError naming the first."""
        self.check_parameters()


@dataclass(frozen=True, slots=True)
class Reply:
    """Reply to a call: payload, encoding string, attachment map with ``kind`` and ``final``."""

    payload: bytes = b""
    encoding: str = ""
    attachment: Mapping[str, Any] = field(default_factory=dict)
    key: str = ""

    @classmethod
    def of(cls, body: Any, **attachment: Any) -> Reply:
        """Return a reply with a MessagePack body as payload."""
        return cls(pack(body), "application/msgpack", attachment)

    @property
    def final(self) -> bool:
        """True if no other reply follows."""
        return bool(self.attachment.get("final", True))

    def body(self) -> Any:
        """Return the payload decoded as MessagePack; raises CodecError."""
        return unpack(self.payload)


def pack(body: Any) -> bytes:
    """Encode data as MessagePack."""
    return bytes(msgpack.packb(body))


def unpack(data: bytes) -> Any:
    """Decode MessagePack bytes; raises CodecError on anything else."""
    if len(data) > _MAX_MAP_BYTES:
        raise CodecError(f"MessagePack of {len(data)} bytes: expected at most {_MAX_MAP_BYTES}")
    try:
        return msgpack.unpackb(data, strict_map_key=False)
    except (ValueError, TypeError, msgpack.UnpackException, msgpack.ExtraData, RecursionError) as error:
        raise CodecError(f"{len(data)} bytes that are not MessagePack: {error}") from error


def with_context(attachment: bytes) -> bytes:
    """Return an attachment, a MessagePack map or empty, with the context of the current span if any."""
    parent = tracing.current()
    if not parent or tracing.PARENT.encode() in attachment:
        return attachment
    body = unpack(attachment) if attachment else {}
    return pack({**body, tracing.PARENT: parent}) if isinstance(body, dict) else attachment


def split_context(attachment: bytes) -> tuple[bytes, str]:
    """Return an attachment without the context of a span, and this context, empty without one."""
    if tracing.PARENT.encode() not in attachment:
        return attachment, ""
    try:
        body = unpack(attachment)
        parent = body.pop(tracing.PARENT)
    except (CodecError, AttributeError, KeyError, TypeError):  # the text is that of a value
        return attachment, ""
    return pack(body) if body else b"", parent if isinstance(parent, str) else ""


def on_map(callback: Callable[[str, dict[str, Any]], None]) -> Callable[[Message], None]:
    """Return a subscriber that calls back with key and MessagePack map; malformed messages are counted and
    logged.
    """
    malformed = 0

    def receive(message: Message) -> None:
        nonlocal malformed
        try:
            body = unpack(message.payload)
            if not isinstance(body, dict):
                raise CodecError(f"got a {type(body).__name__}, expected a map")
            callback(message.key, body)
        except (CdffError, LookupError, TypeError, ValueError, ArithmeticError, AttributeError) as error:
            malformed += 1
            logger.warning("malformed message on %s (%d so far): %s", message.key, malformed, error)

    return receive


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
    """Format parameters as text, the inverse of ``parse_parameters``; ``, : / -`` are not escaped.

    Raises
    ------
    InputError
        If UTF-8 cannot represent a value.
    """
    try:
        return ";".join(f"{name}={quote(str(value), safe=',:/-')}" for name, value in parameters.items())
    except UnicodeEncodeError as error:
        raise InputError(f"parameters: {error}; expected text that UTF-8 can represent") from error


def parameters_of_malformed(text: str) -> dict[str, str]:
    """Return the parameters of a possibly malformed text, unchecked, to repeat them in an error body."""
    pairs = (part.partition("=") for part in text.split(";")[:_MAX_PARAMETERS] if part)
    return {name: unquote_to_bytes(value).decode("utf-8", "replace") for name, _, value in pairs}


def error_body(error: BaseException, asked: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Return ``{code, retriable, detail, request, asked}`` of an error, with ``retry_after_s`` if known.

    ``asked`` are the received parameters, replaced by the parsed request if the error has one.
    """
    code, retriable = rpc_code(error)
    asked = asked or {}
    body = {
        "code": code,
        "retriable": retriable,
        "detail": public_text(error),
        "request": asked.get("request", "")[:200] or getattr(error, "request", ""),
        "asked": dict(getattr(error, "asked", None) or asked),
    }
    if isinstance(error, UnavailableError) and error.retry_after_s is not None:
        body["retry_after_s"] = error.retry_after_s
    return body


def error_of(body: Any) -> CdffError:
    """Return the exception that a client raises for an error body."""
    if not isinstance(body, dict) or "code" not in body:
        return CdffError(f"malformed error reply {body!r}")
    kind = ERROR_OF_CODE.get(str(body["code"]), CdffError)
    if kind is CdffError and body.get("retriable"):
        kind = StorageError  # of the internal errors only a full disk is worth a retry (RPC_CODES)
    error = kind(str(body.get("detail", "")))
    if isinstance(error, UnavailableError) and "retry_after_s" in body:
        error.retry_after_s = float(body["retry_after_s"])
    error.retriable = bool(body.get("retriable", False))
    error.request, error.asked = str(body.get("request", "")), body.get("asked")
    return error

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every error this framework raises on purpose, named by what the caller can do about it.

::

    CdffError
    ├── ConfigurationError        fix the configuration, profile or description
    ├── InputError                fix the data that was handed in
    │   └── CodecError            the bytes are not what they were said to be
    ├── RefusedError              the algorithm will not stand for an answer (result FAILED)
    │   └── DegenerateGeometryError   the data leave directions free; ``directions`` names them
    ├── FrameNotFoundError        name a frame that is in the tree
    ├── ExtrapolationError        ask inside the time span that is known
    ├── ProductNotFoundError      ask for something that exists
    ├── ConflictError             same id, other content; or somebody else changed it first
    ├── NotActiveError            activate the DFPC first
    ├── UnavailableError          try again later, or ask somebody else
    │   ├── NoAnswerError         nobody is there, or the answer broke off; asking again is safe
    │   ├── DeadlineError         give more time
    │   └── OverloadedError       come back after ``retry_after_s``
    ├── DeniedError               you lack the right
    └── StorageError              the disk is full or broken

A message names the thing, the value, what was expected and what to try. ``RPC_CODES`` and
``HTTP_STATUS`` are the only tables that map these classes to the wire.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any


class CdffError(Exception):
    """Root of all errors raised on purpose by the framework.

    ``retriable`` is set where the error came from another process, which says whether trying again makes sense.
    ``request`` is the id of the request it answers, set where the one who raises it made that id; ``asked`` is that
    request as it was understood, set where it was.
    """

    retriable: bool | None = None
    request: str = ""
    asked: Mapping[str, Any] | None = None


class ConfigurationError(CdffError):
    """A configuration, profile or description is wrong."""


class InputError(CdffError):
    """The data handed in cannot be used: wrong shape, type, unit, range or name."""


class CodecError(InputError):
    """Bytes could not be decoded as the type and encoding they were said to be, or a value not encoded."""


class RefusedError(CdffError):
    """An algorithm refuses to answer; ``reasons`` says why (status FAILED)."""

    def __init__(self, message: str, reasons: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.reasons: tuple[str, ...] = tuple(reasons)


class DegenerateGeometryError(RefusedError):
    """The data leave some directions of the estimate free; ``directions`` names them."""

    def __init__(self, message: str, directions: Sequence[str] = ()) -> None:
        super().__init__(message, reasons=[f"degenerate:{name}" for name in directions])
        self.directions: tuple[str, ...] = tuple(directions)


class FrameNotFoundError(CdffError):
    """A frame is not in the tree, or no chain joins two frames."""


class ExtrapolationError(CdffError):
    """A time lies outside the span that is known, by more than the stated limit."""


class ProductNotFoundError(CdffError):
    """No product, job or resource with that name."""


class ConflictError(CdffError):
    """The same id with other content, or a change that came too late."""


class NotActiveError(CdffError):
    """The DFPC that would answer is not active."""


class UnavailableError(CdffError):
    """Nobody can answer now."""


class NoAnswerError(UnavailableError):
    """Nobody is there to answer, or the answer broke off before its end; asking again is safe."""


class DeadlineError(UnavailableError):
    """The answer did not come before the deadline."""


class OverloadedError(UnavailableError):
    """Too much asked at once; try again after ``retry_after_s`` seconds."""

    def __init__(self, message: str, retry_after_s: float = 1.0) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s


class DeniedError(CdffError):
    """The caller lacks the right."""


class StorageError(CdffError):
    """The disk is full, or gave back something else than was written."""


#: Error class -> (RPC code of contract §5, retriable). First match along the class's ancestry wins.
RPC_CODES: dict[type[CdffError], tuple[str, bool]] = {
    CodecError: ("INVALID_ARGUMENT", False),
    InputError: ("INVALID_ARGUMENT", False),
    ConfigurationError: ("INVALID_ARGUMENT", False),
    ConflictError: ("INVALID_ARGUMENT", False),
    FrameNotFoundError: ("NOT_FOUND", False),
    ExtrapolationError: ("NOT_FOUND", True),
    ProductNotFoundError: ("NOT_FOUND", False),
    NotActiveError: ("NOT_ACTIVE", True),
    DeadlineError: ("DEADLINE", True),
    OverloadedError: ("OVERLOADED", True),
    UnavailableError: ("UNAVAILABLE", True),
    RefusedError: ("UNAVAILABLE", True),
    DeniedError: ("DENIED", False),
    StorageError: ("INTERNAL", True),
}

#: Error class -> HTTP status of the problem document (RFC 9457).
HTTP_STATUS: dict[type[CdffError], int] = {
    CodecError: 422,
    InputError: 422,
    ConfigurationError: 422,
    ConflictError: 409,
    FrameNotFoundError: 404,
    ExtrapolationError: 404,
    ProductNotFoundError: 404,
    NotActiveError: 409,
    DeadlineError: 504,
    OverloadedError: 503,
    UnavailableError: 503,
    RefusedError: 422,
    DeniedError: 403,
    StorageError: 507,
}

#: RPC code -> the class a client raises for it.
ERROR_OF_CODE: dict[str, type[CdffError]] = {
    "INVALID_ARGUMENT": InputError,
    "NOT_FOUND": ProductNotFoundError,
    "NOT_ACTIVE": NotActiveError,
    "UNAVAILABLE": UnavailableError,
    "DEADLINE": DeadlineError,
    "OVERLOADED": OverloadedError,
    "DENIED": DeniedError,
    "INTERNAL": CdffError,
}


def rpc_code(error: BaseException) -> tuple[str, bool]:
    """Return the RPC code of contract §5 and whether a retry makes sense; unknown errors are INTERNAL."""
    for cls in type(error).__mro__:
        if cls in RPC_CODES:
            return RPC_CODES[cls]
    return ("INTERNAL", False)


def http_status(error: BaseException) -> int:
    """Return the HTTP status for an error; unknown errors are 500."""
    for cls in type(error).__mro__:
        if cls in HTTP_STATUS:
            return HTTP_STATUS[cls]
    return 500

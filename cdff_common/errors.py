# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of the framework, one class for each reaction of the caller.

::

    CdffError
    ├── ConfigurationError        fix the configuration, profile or description
    │   └── FaultsError           all faults of a profile, one line each
    ├── InputError                fix the input data
    │   └── CodecError            the bytes do not match their type and encoding
    ├── RefusedError              the algorithm cannot give a trustworthy result (status FAILED)
    │   └── DegenerateGeometryError   the data leave ``directions`` unconstrained
    ├── FrameNotFoundError        use a frame of the tree
    ├── ExtrapolationError        request a time inside the known interval
    ├── ProductNotFoundError      request something that exists
    ├── ConflictError             the id exists with other content, or a concurrent change
    ├── NotActiveError            activate the DFPC first
    ├── UnavailableError          retry later, or use another service
    │   ├── NoAnswerError         no service answers, or its answer is incomplete; a retry is safe
    │   ├── DeadlineError         allow more time
    │   ├── OverloadedError       retry after ``retry_after_s``
    │   └── ClockSkewError        a stamp is ahead of mission time; set the clocks, then retry
    ├── DeniedError               a permission is missing
    └── StorageError              the disk is full or defective

A message names the item, its value, the expectation and a remedy. ``RPC_CODES`` and ``HTTP_STATUS`` are the
only mappings of these classes to RPC codes and HTTP statuses.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any


class CdffError(Exception):
    """Base class of the errors of the framework.

    ``retriable`` is set for an error of another process, which decides whether a retry makes sense.
    ``request`` is the id of the failed request if the service assigned it; ``asked`` is the parsed request,
    None if it could not be parsed.
    """

    retriable: bool | None = None
    request: str = ""
    asked: Mapping[str, Any] | None = None


class ConfigurationError(CdffError):
    """Invalid configuration, profile or description."""


class FaultsError(ConfigurationError):
    """Several faults of one file; the text has one line for each.

    Attributes
    ----------
    faults : tuple
        Faults, each with a text for a message.
    """

    def __init__(self, faults: Sequence[object]) -> None:
        super().__init__("\n".join(str(fault) for fault in faults))
        self.faults = tuple(faults)


class InputError(CdffError):
    """Unusable input data: wrong shape, type, unit, range or name."""


class CodecError(InputError):
    """Bytes that cannot be decoded in the stated type and encoding, or a value that cannot be encoded."""


class RefusedError(CdffError):
    """Refusal of an algorithm to return a result (status FAILED); ``reasons`` lists the causes."""

    def __init__(self, message: str, reasons: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.reasons: tuple[str, ...] = tuple(reasons)


class DegenerateGeometryError(RefusedError):
    """Data that leave some directions of the estimate unconstrained; ``directions`` lists them."""

    def __init__(self, message: str, directions: Sequence[str] = ()) -> None:
        super().__init__(message, reasons=[f"degenerate:{name}" for name in directions])
        self.directions: tuple[str, ...] = tuple(directions)


class FrameNotFoundError(CdffError):
    """Frame that is not in the tree, or two frames without a connecting chain."""


class ExtrapolationError(CdffError):
    """Time outside the known interval by more than the stated limit."""


class ProductNotFoundError(CdffError):
    """Missing product, job or resource."""


class ConflictError(CdffError):
    """Same id with other content, or a change that conflicts with an earlier one."""


class NotActiveError(CdffError):
    """Request to a DFPC that is not active."""


class UnavailableError(CdffError):
    """Service that cannot answer now.

    ``retry_after_s`` is set if the same request is expected to succeed after this time, seconds.
    """

    retry_after_s: float | None = None

    def __init__(self, message: str = "", retry_after_s: float | None = None) -> None:
        super().__init__(message)
        self.retry_after_s = retry_after_s


class NoAnswerError(UnavailableError):
    """No answer, or an incomplete one; a retry is safe."""


class DeadlineError(UnavailableError):
    """No answer before the deadline."""


class OverloadedError(UnavailableError):
    """Too many requests; retry after ``retry_after_s`` seconds."""

    retry_after_s: float

    def __init__(self, message: str, retry_after_s: float = 1.0) -> None:
        super().__init__(message, retry_after_s)


class ClockSkewError(UnavailableError):
    """Stamp ahead of mission time by more than clocks may differ; accepted when the clocks agree."""


class DeniedError(CdffError):
    """Missing permission of the caller."""


class StorageError(CdffError):
    """Full disk, or data that differ from the written ones."""


#: Error class -> (RPC code, retriable). The first match in the method resolution order applies.
RPC_CODES: dict[type, tuple[str, bool]] = {
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
HTTP_STATUS: dict[type, int] = {
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

#: RPC code -> class that a client raises.
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


def public_text(error: BaseException) -> str:
    """Return the text of an error for other processes; that of an unexpected one is only in the log."""
    if isinstance(error, CdffError):
        return str(error)
    return f"internal error ({type(error).__name__}): the log of the service has the details"


def rpc_code(error: BaseException) -> tuple[str, bool]:
    """Return the RPC code and whether a retry makes sense; unknown errors are INTERNAL."""
    return next((RPC_CODES[cls] for cls in type(error).__mro__ if cls in RPC_CODES), ("INTERNAL", False))


def http_status(error: BaseException) -> int:
    """Return the HTTP status for an error; unknown errors are 500."""
    return next((HTTP_STATUS[cls] for cls in type(error).__mro__ if cls in HTTP_STATUS), 500)

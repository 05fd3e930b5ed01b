# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Limit of the time that one request may take: no client waits for the answer of a longer one."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from cdff_common.clock import monotonic_s
from cdff_common.errors import OverloadedError

#: Time after which a client may repeat a request that took too long.
_RETRY_S = 30.0
#: Limit of the current request, seconds, and the monotonic time at which it is over; None: no limit.
_LIMIT: ContextVar[tuple[float, float] | None] = ContextVar("time_limit", default=None)


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """End the work of the block at the first check after ``seconds``."""
    token = _LIMIT.set((seconds, monotonic_s() + seconds))
    try:
        yield
    finally:
        _LIMIT.reset(token)


def check_time(read_count: int, total: int, unit: str) -> None:
    """Raise OverloadedError if the time of the current request is over, with the part that is done."""
    limit = _LIMIT.get()
    if limit is not None and monotonic_s() > limit[1]:
        raise OverloadedError(
            f"{read_count} of {total} {unit} were read in {limit[0]:g} s; ask for a smaller region or a shorter "
            "time, or repeat the request when fewer others run",
            _RETRY_S,
        )


def time_left_s(most_s: float) -> float:
    """Return the time that the current request may still take, at most ``most_s``."""
    limit = _LIMIT.get()
    return most_s if limit is None else min(most_s, limit[1] - monotonic_s())

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Commits of other processes with the same store, and the lease of the process that maintains it."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Protocol


def ignore() -> None:
    """Do nothing after a commit."""


class CommitWatch(Protocol):
    """Calls a function after the commits of every process, until it is closed.

    Attributes
    ----------
    on_commit : callable
        Called in another thread after one or several commits.
    """

    on_commit: Callable[[], None]

    def wait_for_lease(self, stop: threading.Event) -> bool:
        """Wait until this process has the lease, which one process has; return False if stopped before."""

    def problem(self) -> str:
        """Return why this process must end: another one has taken its lease; empty otherwise."""

    def close(self) -> None:
        """Stop, and release the lease."""


class EmbeddedWatch:
    """``CommitWatch`` of a store that only one process opens: its lock file is the lease."""

    def __init__(self) -> None:
        self.on_commit = ignore

    def wait_for_lease(self, stop: threading.Event) -> bool:
        """Return at once; False if stopped."""
        return not stop.is_set()

    def problem(self) -> str:
        """Return an empty text: the lock file keeps other processes out."""
        return ""

    def close(self) -> None:
        """Do nothing."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One orchestrator for each robot, and one for each journal: who comes second is told who leads, and ends.

A process says with a token of its own name that it would lead, and looks who else does, twice: of those that begin at a
time the first one stays, and each has time to see the others.
"""

from __future__ import annotations

import fcntl
import os
import re
import socket
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from cdff_common.bus import Bus, keys
from cdff_common.clock import format_stamp, wall_ns
from cdff_common.errors import StorageError, UnavailableError

#: What may lie between two processes' tokens that each thinks it was first, seconds.
_SETTLE_S = 0.2


@dataclass(frozen=True, order=True, slots=True)
class Candidate:
    """A process that leads, or would: since when (wall clock), its pid and its host."""

    since_ns: int
    pid: int
    host: str

    @classmethod
    def own(cls) -> Self:
        """The process that asks, from now on."""
        return cls(wall_ns(), os.getpid(), re.sub(r"[^a-z0-9_]", "_", socket.gethostname().lower()) or "unknown")

    @classmethod
    def parse(cls, name: str) -> Self:
        """Inverse of ``name``."""
        since_ns, pid, host = name.split("_", 2)
        return cls(int(since_ns), int(pid), host)

    @property
    def name(self) -> str:
        """As the last chunk of its token."""
        return f"{self.since_ns}_{self.pid}_{self.host}"

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host} since {format_stamp(self.since_ns)}"


def lock_folder(folder: Path, own: Candidate) -> int:
    """Have a folder with a journal to this process alone, until it ends; the descriptor that holds it.

    Raises
    ------
    UnavailableError
        Naming the process that has it.
    StorageError
        If the folder cannot be written.
    """
    path = folder / "lock"
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise StorageError(f"{path}: {error}") from error
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        leader = os.read(descriptor, 256).decode(errors="replace")
        os.close(descriptor)
        raise UnavailableError(f"{folder} belongs to another orchestrator, {leader or 'which just began'}") from error
    os.ftruncate(descriptor, 0)
    os.write(descriptor, str(own).encode())
    return descriptor


def claim(bus: Bus, robots: tuple[str, ...]) -> Candidate:
    """Say that this process leads some robots, and make sure that no other does; raises UnavailableError naming it."""
    scopes = (*robots, keys.GROUND)
    own = Candidate.own()
    for scope in scopes:
        bus.declare_token(keys.lead(scope, own.name))
    for pause_s in (0.0, _SETTLE_S):
        time.sleep(pause_s)
        for scope in scopes:
            others = {Candidate.parse(k.rsplit("/", 1)[1]) for k in bus.alive(keys.lead(scope, "*"))} - {own}
            answers = bool(bus.alive(keys.alive(scope, "orchestrator")))
            if answers or (others and min(others) < own):
                who = f": {min(others)}" if others else ""
                raise UnavailableError(f"another orchestrator leads {scope}{who}; stop it first")
    return own

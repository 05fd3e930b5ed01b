# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Leader election: one orchestrator for each robot and for each journal; a second process ends with an error.

A process declares a token with its own name and checks the tokens of others twice; of processes that start
at the same time, the one with the earliest start time leads.
"""

from __future__ import annotations

import os
import re
import socket
import time
from dataclasses import dataclass
from typing import Self

from cdff_common.bus import Bus, keys
from cdff_common.clock import format_stamp, wall_ns
from cdff_common.errors import UnavailableError

#: Time after which the tokens of simultaneously started processes are visible, seconds.
_SETTLE_S = 0.2


@dataclass(frozen=True, order=True, slots=True)
class ProcessIdentity:
    """Start time (wall clock), pid and host of an orchestrator process."""

    since_ns: int
    pid: int
    host: str

    @classmethod
    def own(cls) -> Self:
        """Return the identity of this process, started now."""
        return cls(
            wall_ns(), os.getpid(), re.sub(r"[^a-z0-9_]", "_", socket.gethostname().lower()) or "unknown"
        )

    @classmethod
    def parse(cls, name: str) -> Self:
        """Return the identity with a ``name``."""
        since_ns, pid, host = name.split("_", 2)
        return cls(int(since_ns), int(pid), host)

    @property
    def name(self) -> str:
        """Last chunk of the token key."""
        return f"{self.since_ns}_{self.pid}_{self.host}"

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host} since {format_stamp(self.since_ns)}"


def claim(bus: Bus, scopes: tuple[str, ...]) -> ProcessIdentity:
    """Claim the lead of some scopes; raises UnavailableError naming the current leader."""
    own = ProcessIdentity.own()
    for scope in scopes:
        bus.declare_token(keys.lead(scope, own.name))
    for pause_s in (0.0, _SETTLE_S):
        time.sleep(pause_s)
        for scope in scopes:
            others = {
                ProcessIdentity.parse(k.rsplit("/", 1)[1]) for k in bus.alive(keys.lead(scope, "*"))
            } - {own}
            is_led = bool(bus.alive(keys.alive(scope, "orchestrator")))
            if is_led or (others and min(others) < own):
                who = f": {min(others)}" if others else ""
                raise UnavailableError(f"another orchestrator leads {scope}{who}; stop it first")
    return own


def claim_robot(bus: Bus, robot: str) -> None:
    """Claim the lead of a robot that joins; raises UnavailableError if another orchestrator serves it."""
    key = keys.alive(robot, "orchestrator")
    if key in bus.alive(key) and not bus.has_token(key):
        raise UnavailableError(f"another orchestrator leads {robot}; stop it first")

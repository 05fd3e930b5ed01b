# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Drive commands to simulated rovers over the bus, in place of a locomotion controller."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.bus.message import pack, unpack
from cdff_common.errors import InputError
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.missions.driven_log import GrowingLog

#: Largest number of corners of a commanded path.
_MAX_CORNERS = 10_000
_TIMEOUT_S = 10.0


def key(robot: str, verb: str) -> str:
    """Return the key of ``drive`` (path in the level base frame) or ``follow`` (path of the scenario)."""
    return f"{keys.PREFIX}/{robot}/simulator/@rpc/{verb}"


def serve(bus: Bus, log: GrowingLog) -> None:
    """Serve drive commands for every rover.

    A reply has the start and end of the motion, mission nanoseconds.
    """
    for robot in log.rovers:
        bus.serve(key(robot, "drive"), partial(_drive, log, robot))
        bus.serve(key(robot, "follow"), partial(_follow, log, robot))
        bus.declare_alive(robot, "simulator")


@dataclass(frozen=True, slots=True)
class Locomotion:
    """Client of the drive commands of one rover."""

    bus: Bus
    robot: str

    def drive(self, path_m: FloatArray) -> tuple[int, int]:
        """Drive along corners ``(n, 2)``, metres ahead and left of the rover.

        Returns start and end of the motion, mission nanoseconds.

        Raises
        ------
        InputError
            If the path is empty or leaves the terrain.
        """
        return self._command("drive", pack({"path_m": np.asarray(path_m, dtype=np.float64).tolist()}))

    def follow(self) -> tuple[int, int]:
        """Drive the path of the scenario; returns like ``drive``."""
        return self._command("follow", b"")

    def _command(self, verb: str, payload: bytes) -> tuple[int, int]:
        """Send a command and return the first and the last time of the motion, nanoseconds."""
        body = self.bus.call(key(self.robot, verb), payload=payload, timeout_s=_TIMEOUT_S).body()
        return int(body["begin_ns"]), int(body["end_ns"])


def _drive(log: GrowingLog, robot: str, request: Request) -> Reply:
    return _reply(log.drive(robot, _parse_path(request)))


def _follow(log: GrowingLog, robot: str, _: Request) -> Reply:
    return _reply(log.follow(robot))


def _parse_path(request: Request) -> FloatArray:
    """Return the corners (n, 2) of a commanded path, metres; raises InputError."""
    body = unpack(request.payload)
    path = body.get("path_m") if isinstance(body, dict) else None
    if not isinstance(path, list) or len(path) > _MAX_CORNERS:
        raise InputError(f"path_m: expected a list of at most {_MAX_CORNERS} corners [x, y]")
    try:
        return np.array(path, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"path_m: {error}; expected corners [x, y] in metres") from error


def _reply(times_ns: tuple[int, int]) -> Reply:
    return Reply.of({"begin_ns": times_ns[0], "end_ns": times_ns[1]})

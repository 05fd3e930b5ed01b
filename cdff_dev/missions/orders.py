# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Orders to simulated rovers over the bus: what the robot's own locomotion would answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.bus.message import pack, unpack
from cdff_common.errors import InputError
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.missions.driven import Driven

#: Most corners of a way.
_MOST_CORNERS = 10_000
_CALL_S = 10.0


def key(robot: str, verb: str) -> str:
    """``drive`` (a way in the level frame of the base) or ``follow`` (the scenario's own way)."""
    return f"{keys.PREFIX}/{robot}/simulator/@rpc/{verb}"


def serve(bus: Bus, driven: Driven) -> None:
    """Take orders for every rover; the reply says when the rover begins and ends, mission nanoseconds."""
    for robot in driven.rovers:
        bus.serve(key(robot, "drive"), lambda request, robot=robot: _reply(driven.drive(robot, _way_of(request))))
        bus.serve(key(robot, "follow"), lambda _request, robot=robot: _reply(driven.follow(robot)))
        bus.declare_alive(robot, "simulator")


@dataclass(frozen=True, slots=True)
class Locomotion:
    """A rover that can be told where to drive."""

    bus: Bus
    robot: str

    def drive(self, way_m: FloatArray) -> tuple[int, int]:
        """Drive corners ``(n, 2)`` ahead of and left of the rover, metres; returns begin and end, mission nanoseconds.

        Raises
        ------
        InputError
            If it drives already, or the way is none or leaves the ground.
        """
        return self._told("drive", pack({"way_m": np.asarray(way_m, dtype=np.float64).tolist()}))

    def follow(self) -> tuple[int, int]:
        """Drive the scenario's own way; as ``drive``."""
        return self._told("follow", b"")

    def _told(self, verb: str, payload: bytes) -> tuple[int, int]:
        body = self.bus.call(key(self.robot, verb), payload=payload, timeout_s=_CALL_S).body()
        return int(body["begin_ns"]), int(body["end_ns"])


def _way_of(request: Request) -> FloatArray:
    body = unpack(request.payload)
    way = body.get("way_m") if isinstance(body, dict) else None
    if not isinstance(way, list) or len(way) > _MOST_CORNERS:
        raise InputError(f"way_m: expected a list of at most {_MOST_CORNERS} corners [x, y]")
    try:
        return np.array(way, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"way_m: {error}; expected corners [x, y] in metres") from error


def _reply(times_ns: tuple[int, int]) -> Reply:
    return Reply.of({"begin_ns": times_ns[0], "end_ns": times_ns[1]})

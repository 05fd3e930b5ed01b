# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Commands to a simulated servicer over the bus, in place of its attitude and orbit control."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.bus.message import pack, unpack
from cdff_common.errors import InputError
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.missions.orbit.guided_log import GuidedLog

_TIMEOUT_S = 15.0


def key(robot: str, verb: str) -> str:
    """Return the key of ``move`` or ``lose_sensor``."""
    return f"{keys.PREFIX}/{robot}/simulator/@rpc/{verb}"


def serve(bus: Bus, log: GuidedLog) -> None:
    """Serve the commands; a reply has the start and end of the motion or loss, mission nanoseconds."""
    robot = log.servicer.scenario.servicer.name
    bus.serve(key(robot, "move"), partial(_move, log, robot))
    bus.serve(key(robot, "lose_sensor"), partial(_lose_sensor, log))
    bus.declare_alive(robot, "simulator")


@dataclass(frozen=True, slots=True)
class Thrusters:
    """Client of the commands."""

    bus: Bus
    robot: str

    def move(self, displacement_m: FloatArray, duration_s: float, frame: str) -> tuple[int, int]:
        """Move by a displacement (3,), metres; return start and end of the motion, mission nanoseconds.

        Parameters
        ----------
        frame : str
            ``inertial``, or ``{robot}/base`` at the start of the motion.

        Raises
        ------
        InputError
            If the servicer still moves, or would come too close to a body.
        """
        body = {
            "displacement_m": np.asarray(displacement_m, float).tolist(),
            "duration_s": float(duration_s),
            "frame": frame,
        }
        return self._call("move", body)

    def lose_sensor(self, sensor: str, duration_s: float) -> tuple[int, int]:
        """Withhold the samples of a sensor, as a fault; return start and end, mission nanoseconds."""
        return self._call("lose_sensor", {"sensor": sensor, "duration_s": float(duration_s)})

    def _call(self, verb: str, body: dict[str, object]) -> tuple[int, int]:
        reply = self.bus.call(key(self.robot, verb), payload=pack(body), timeout_s=_TIMEOUT_S).body()
        return int(reply["begin_ns"]), int(reply["end_ns"])


def _move(log: GuidedLog, robot: str, request: Request) -> Reply:
    body = unpack(request.payload)
    frames = ("inertial", f"{robot}/base")
    if not isinstance(body, dict) or body.get("frame") not in frames:
        raise InputError(f"frame: expected one of {', '.join(frames)}")
    try:
        displacement_m = np.asarray(body["displacement_m"], dtype=float).reshape(3)
        duration_s = float(body["duration_s"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"displacement_m, duration_s: {error}; expected [x, y, z] and seconds") from error
    return _reply(log.move(displacement_m, duration_s, in_base=body["frame"] != "inertial"))


def _lose_sensor(log: GuidedLog, request: Request) -> Reply:
    body = unpack(request.payload)
    try:
        sensor, duration_s = str(body["sensor"]), float(body["duration_s"])
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"sensor, duration_s: {error}; expected a name and seconds") from error
    return _reply(log.lose_sensor(sensor, duration_s))


def _reply(times_ns: tuple[int, int]) -> Reply:
    return Reply.of({"begin_ns": times_ns[0], "end_ns": times_ns[1]})

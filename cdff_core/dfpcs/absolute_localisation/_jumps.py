# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Jumps of the frame that the robot's poses are in: a filter that took a fix moves the frame, not the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import ExtrapolationError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.frame_graph import PoseTrack

Float = NDArray[np.float64]

#: How far beyond its newest pose the odometry is taken to go on, and how long it is kept, nanoseconds.
_AHEAD_NS, _KEPT_NS = 500_000_000, 60_000_000_000
#: Of a step that odometry measured: what slip explains. No wheels are faster than this: they count from a new origin.
_SLIP_SHARE, _MAX_SPEED_M_S, _SHORTEST_S = 0.2, 5.0, 0.1
#: Without odometry a step is expected to be as the one before: what steering and braking explain, starting in 1 s.
_STEERED_SHARE, _STARTED_M = 0.7, 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """From one pose to the next.

    Attributes
    ----------
    way_m : float
        Driven, without the jump.
    jumped : bool
    frame : Float or None, shape (4, 4)
        Of a jump that odometry tells exactly: ``T_new_old`` of the frame, a shift and a turn about z.
    """

    way_m: float
    jumped: bool = False
    frame: Float | None = None


class Jumps:
    """Tells what was driven from what was corrected.

    Parameters
    ----------
    floor_m, floor_rad : float
        Jumps that odometry must tell; smaller ones are as drift.
    """

    def __init__(self, floor_m: float, floor_rad: float) -> None:
        self._floor_m, self._floor_rad = floor_m, floor_rad
        self._odometry, self._poses = PoseTrack(), PoseTrack()
        self._before: tuple[int, Float] | None = None

    def odometry(self, stamp_ns: int, T_odom_base: Float) -> None:
        """Take a pose in a frame that does not jump."""
        if self._odometry.stamps_ns:
            last_ns = self._odometry.stamps_ns[-1]
            moved_m = _length(T_odom_base[:3, 3] - self._odometry.poses[last_ns].matrix[:3, 3])
            if moved_m > _MAX_SPEED_M_S * max(abs(stamp_ns - last_ns) * 1e-9, _SHORTEST_S):
                self._odometry = PoseTrack()
        _keep(self._odometry, stamp_ns, T_odom_base)

    def step(self, stamp_ns: int, T_map_base: Float) -> Step:
        """Take the next pose."""
        before, self._before = self._before, (stamp_ns, T_map_base)
        made = Step(0.0) if before is None else self._step(*before, stamp_ns, T_map_base)
        if made.jumped:
            self._poses = PoseTrack()
        _keep(self._poses, stamp_ns, T_map_base)
        return made

    def _step(self, begin_ns: int, T_begin: Float, end_ns: int, T_end: Float) -> Step:
        way_m = _length(T_end[:3, 3] - T_begin[:3, 3])
        measured = _motion(self._odometry, begin_ns, end_ns)
        expected = _motion(self._poses, 2 * begin_ns - end_ns, begin_ns) if measured is None else measured
        if expected is None or end_ns <= begin_ns:
            return Step(way_m)
        T_expected = T_begin @ expected
        expected_m = _length(expected[:3, 3])
        off_m = _length(T_end[:3, 3] - T_expected[:3, 3])
        if measured is None:
            started_m = _STARTED_M * max(1.0, (end_ns - begin_ns) * 1e-9)
            gone = off_m > started_m + _STEERED_SHARE * expected_m
            return Step(expected_m, True) if gone else Step(way_m)
        turn_rad = _yaw(T_end[:3, :3] @ T_expected[:3, :3].T)
        allowed_rad = self._floor_rad + _SLIP_SHARE * abs(_yaw(expected[:3, :3]))
        if off_m <= self._floor_m + _SLIP_SHARE * expected_m and abs(turn_rad) <= allowed_rad:
            return Step(way_m)
        R = se3.exp_so3(np.array([0.0, 0.0, turn_rad]))
        return Step(expected_m, True, se3.transform(R, T_end[:3, 3] - R @ T_expected[:3, 3]))


def _motion(track: PoseTrack, begin_ns: int, end_ns: int) -> Float | None:
    """``T_base(begin)_base(end)``, None where the track has not both times."""
    try:
        return np.asarray(se3.inverse(_at(track, begin_ns)) @ _at(track, end_ns))
    except ExtrapolationError:
        return None


def _at(track: PoseTrack, stamp_ns: int) -> Float:
    """The pose at a time; just after the newest it goes on as it went. Raises ExtrapolationError elsewhere."""
    last_ns = track.stamps_ns[-1] if track.stamps_ns else stamp_ns
    if not 0 < stamp_ns - last_ns <= _AHEAD_NS:
        return track.at(stamp_ns).matrix
    last, before = track.poses[last_ns].matrix, track.at(2 * last_ns - stamp_ns).matrix
    return np.asarray(last @ se3.inverse(before) @ last)


def _keep(track: PoseTrack, stamp_ns: int, T: Float) -> None:
    track.insert(stamp_ns, UncertainTransform(T))
    track.forget_before(stamp_ns - _KEPT_NS)


def _length(v: Float) -> float:
    return float(np.linalg.norm(v))


def _yaw(R: Float) -> float:
    return float(np.arctan2(R[1, 0], R[0, 0]))

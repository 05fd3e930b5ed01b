# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The frame tree around the moving base: fixed frames of the site above it, mounts and joints below it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import FrameNotFoundError, InputError
from cdff_common.geometry import FrameGraph, UncertainTransform
from cdff_common.geometry.frame_graph import PoseTrack
from cdff_common.geometry.se3 import FloatArray
from cdff_common.geometry.urdf import Joint, RobotModel, read_urdf
from cdff_common.types import Joints

_EXACT = np.zeros((6, 6))
#: How long the last value of a joint stands for itself, nanoseconds: joints speak when they move.
_HOLD_NS = 3_600_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class JointValues:
    """Values of a joint over time.

    Attributes
    ----------
    stamps_ns : array, shape (n,)
    values : array, shape (n,)
        Radians or metres.
    broken_ns : set of int
        Stamps before which values were forgotten.
    """

    stamps_ns: NDArray[np.int64]
    values: FloatArray
    broken_ns: set[int]


class RobotFrames:
    """Two trees: that of the site and that of the base; the time line joins them.

    Parameters
    ----------
    context : FrameGraph
        Fixed frames: mounts below ``{robot}/base``, ``site`` to ``{robot}/odom`` where it was surveyed.
    urdf : str
        Document of the robot's internal joints; empty where it has none.
    """

    def __init__(self, robot: str, context: FrameGraph, urdf: str) -> None:
        self.robot, self.base, self.odom = robot, f"{robot}/base", f"{robot}/odom"
        self._graph = FrameGraph()
        for child in context.frames:
            parent = context.parent_of(child)
            if parent is not None:
                self._graph.set_static(parent, child, context.lookup(parent, child, 0))
        if self.odom not in self._graph.frames:
            self._graph.set_static("site", self.odom, UncertainTransform.identity())
        self._model: RobotModel | None = read_urdf(urdf) if urdf else None
        #: Joints that have a value: where they are in the tree, and their values by time.
        self._joints: dict[str, tuple[PoseTrack, Joint]] = {}
        self._values: dict[str, dict[int, float]] = {}
        for joint in self._model.joints if self._model else ():
            parent, child = self._model.frame(robot, joint.parent), self._model.frame(robot, joint.child)
            if not joint.movable:
                self._graph.set_static(parent, child, UncertainTransform(joint.origin, _EXACT))
            else:
                self._joints[joint.name] = (self._graph.track(parent, child, _HOLD_NS), joint)
                self._values[joint.name] = {}

    @property
    def movable_joints(self) -> tuple[str, ...]:
        """Names of the joints that have a value, sorted."""
        return tuple(sorted(self._joints))

    def moves(self, frame: str) -> bool:
        """Whether a frame hangs on the base; raises FrameNotFoundError for one that is nowhere in the tree."""
        if frame == self.base:
            return True
        if frame != "site" and frame not in self._graph.frames:
            known = ", ".join(sorted({*self._graph.frames, self.base}))
            raise FrameNotFoundError(f"frame {frame!r} is not known; known are {known}")
        above = frame
        while (parent := self._graph.parent_of(above)) is not None:
            above = parent
        return above == self.base

    def knows(self, frame: str) -> bool:
        """Whether a frame is in the tree."""
        return frame in ("site", self.base) or frame in self._graph.frames

    def fixed(self, parent: str, child: str) -> UncertainTransform:
        """``T_parent_child`` of two frames of the site's tree."""
        return UncertainTransform.identity() if parent == child else self._graph.lookup(parent, child, 0)

    def on_robot(self, parent: str, child: str, stamp_ns: int) -> UncertainTransform:
        """``T_parent_child`` of two frames of the base's tree; raises ExtrapolationError on a joint without values."""
        return UncertainTransform.identity() if parent == child else self._graph.lookup(parent, child, stamp_ns)

    def set_joints(self, joints: Joints, stamp_ns: int, forget_before_ns: int, keep_ns: Iterable[int] = ()) -> None:
        """Take joint values, forget those before a time but what times to keep need.

        Raises
        ------
        InputError
            For a joint that the URDF has not, or a value outside its limits.
        """
        values = {name: state.position for name, state in zip(joints.names, joints.elements, strict=True)}
        unknown = sorted(set(values) - set(self._joints))
        if unknown:
            known = ", ".join(self.movable_joints) or "none"
            raise InputError(f"joint {unknown[0]!r} is not movable in the URDF; movable are {known}")
        for name, (track, joint) in self._joints.items():
            value = values.get(name)
            if joint.mimic is not None and joint.mimic[0] in values:
                value = values[joint.mimic[0]] * joint.mimic[1] + joint.mimic[2]
            if value is None:
                continue
            self._set(name, stamp_ns, value)
            track.forget_before(forget_before_ns, keep_ns)
            # In blocks: each value is looked at.
            if len(self._values[name]) > 2 * len(track.poses) + 64:
                self._values[name] = {t: self._values[name][t] for t in track.stamps_ns}

    def joint_values(self) -> dict[str, JointValues]:
        """What is kept of each joint that spoke."""
        kept = {}
        for name, (track, _) in self._joints.items():
            if track.stamps_ns:
                values = [self._values[name][t] for t in track.stamps_ns]
                kept[name] = JointValues(np.array(track.stamps_ns, dtype=np.int64), np.array(values), set(track.broken))
        return kept

    def restore(self, kept: Mapping[str, JointValues]) -> None:
        """Take up what was kept; joints that the URDF no longer has, and values beyond its limits, are left out."""
        for name, joint in kept.items():
            if name not in self._joints:
                continue
            for stamp_ns, value in zip(joint.stamps_ns.tolist(), joint.values.tolist(), strict=True):
                try:
                    self._set(name, stamp_ns, value)
                except InputError:
                    continue
            track = self._joints[name][0]
            track.broken = {t for t in joint.broken_ns if t in track.poses}

    def _set(self, name: str, stamp_ns: int, value: float) -> None:
        track, joint = self._joints[name]
        low, high = joint.limits or (-np.inf, np.inf)
        if not low - 1e-6 <= value <= high + 1e-6:
            raise InputError(f"joint {name!r}: {value:.6g}, expected {low:.6g} to {high:.6g}")
        track.insert(stamp_ns, UncertainTransform(joint.transform(value), _EXACT))
        self._values[name][stamp_ns] = value

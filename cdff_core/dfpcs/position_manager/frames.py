# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The frame tree around the moving base: fixed frames of the site above it, mounts and joints below it."""

from __future__ import annotations

import numpy as np

from cdff_common.errors import FrameNotFoundError, InputError
from cdff_common.geometry import FrameGraph, UncertainTransform
from cdff_common.geometry.urdf import RobotModel, read_urdf
from cdff_common.types import Joints

_EXACT = np.zeros((6, 6))
#: How long the last value of a joint stands for itself, nanoseconds: joints speak when they move.
_HOLD_NS = 3_600_000_000_000


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
        self._movable: set[str] = set()
        for joint in self._model.joints if self._model else ():
            parent, child = self._model.frame(robot, joint.parent), self._model.frame(robot, joint.child)
            if not joint.movable:
                self._graph.set_static(parent, child, UncertainTransform(joint.origin, _EXACT))
            else:
                self._graph.track(parent, child, _HOLD_NS)
                self._movable.add(joint.name)

    @property
    def movable_joints(self) -> tuple[str, ...]:
        """Names of the joints that have a value, sorted."""
        return tuple(sorted(self._movable))

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

    def set_joints(self, joints: Joints, stamp_ns: int, forget_before_ns: int) -> None:
        """Take joint values; raises InputError for a joint that the URDF has not, or a value outside its limits."""
        values = {name: state.position for name, state in zip(joints.names, joints.elements, strict=True)}
        unknown = sorted(set(values) - self._movable)
        if unknown:
            known = ", ".join(self.movable_joints) or "none"
            raise InputError(f"joint {unknown[0]!r} is not movable in the URDF; movable are {known}")
        for joint in self._model.joints if self._model else ():
            value = values.get(joint.name)
            if joint.mimic is not None and joint.mimic[0] in values:
                value = values[joint.mimic[0]] * joint.mimic[1] + joint.mimic[2]
            if value is None or not joint.movable:
                continue
            low, high = joint.limits or (-np.inf, np.inf)
            if not low - 1e-6 <= value <= high + 1e-6:
                raise InputError(f"joint {joint.name!r}: {value:.6g}, expected {low:.6g} to {high:.6g}")
            assert self._model is not None  # its joints are looped over
            parent, child = self._model.frame(self.robot, joint.parent), self._model.frame(self.robot, joint.child)
            track = self._graph.track(parent, child, _HOLD_NS)
            track.insert(stamp_ns, UncertainTransform(joint.transform(value), _EXACT))
            track.forget_before(forget_before_ns)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Frame tree around the moving base: fixed frames of the site, and mounts and joints of the robot."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import ExtrapolationError, FrameNotFoundError, InputError
from cdff_common.geometry import FrameGraph, PoseTrack, UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_common.geometry.urdf import Joint, read_urdf
from cdff_common.interfaces.dfpc import DfpcContext
from cdff_common.types import Joints

#: Validity of the last value of a joint, nanoseconds: joints are published only when they move.
_HOLD_NS = 3_600_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class JointValues:
    """Values of one joint over time."""

    stamps_ns: NDArray[np.int64]  # (n,)
    values: FloatArray  # (n,), radians or metres
    gaps_ns: set[int]  # stamps before which values were removed


class RobotFrames:
    """Two frame trees, of the site and of the base, which the timeline connects.

    ``context`` has the mounts below ``{robot}/base`` and, if surveyed, the transform from ``{robot}/odom`` to
    ``site``; the URDF document, which may be empty, describes the joints. ``imu`` is the frame of the
    IMU, by default ``{robot}/imu``.
    """

    def __init__(self, robot: str, context: FrameGraph, urdf: str, imu: str = "") -> None:
        self.robot, self.base, self.odom = robot, f"{robot}/base", f"{robot}/odom"
        self.imu = imu or f"{robot}/imu"
        self._graph = FrameGraph()
        for child in context.frames:
            parent = context.parent_of(child)
            if parent is not None:
                self._graph.set_static(parent, child, context.lookup(parent, child, 0))
        if self.odom not in self._graph.frames:
            self._graph.set_static("site", self.odom, UncertainTransform.identity())
        #: Movable joints by name: track in the tree and model; and their values by time.
        self._joints: dict[str, tuple[PoseTrack, Joint]] = {}
        self._values: dict[str, dict[int, float]] = {}
        if not urdf:
            return
        model = read_urdf(urdf)
        for joint in model.joints:
            parent, child = model.frame(robot, joint.parent), model.frame(robot, joint.child)
            if not joint.movable:
                self._graph.set_static(parent, child, UncertainTransform.exact(joint.origin))
            else:
                self._joints[joint.name] = (self._graph.track(parent, child, _HOLD_NS), joint)
                self._values[joint.name] = {}

    @classmethod
    def of(cls, context: DfpcContext) -> RobotFrames:
        """Return the frame trees of a compound's context."""
        return cls(context.robot, context.frames, context.urdf, context.sensor_frame("imu", "imu"))

    @property
    def movable_joints(self) -> tuple[str, ...]:
        """Names of the movable joints, sorted."""
        return tuple(sorted(self._joints))

    def is_on_robot(self, frame: str) -> bool:
        """Return whether a frame is in the base's tree; raises FrameNotFoundError if it is in neither."""
        if frame == self.base:
            return True
        if frame != "site" and frame not in self._graph.frames:
            known_frames = ", ".join(sorted({*self._graph.frames, self.base}))
            raise FrameNotFoundError(f"frame {frame!r}: unknown, expected one of {known_frames}")
        root = frame
        while (parent := self._graph.parent_of(root)) is not None:
            root = parent
        return root == self.base

    def is_placed(self, frame: str, stamp_ns: int) -> bool:
        """Return whether the place of a frame on the robot is known at a time."""
        try:
            self.on_robot(self.base, frame, stamp_ns)
        except (FrameNotFoundError, ExtrapolationError):
            return False
        return True

    def mount(self, frame: str, stamp_ns: int) -> FloatArray:
        """Return ``T_base_frame`` (4, 4) at a time."""
        return self.on_robot(self.base, frame, stamp_ns).matrix

    def mount_covariance(self, frame: str, stamp_ns: int) -> FloatArray | None:
        """Return the covariance (6, 6) of ``T_base_frame`` in base axes; None if no edge has a covariance."""
        covariance = self.on_robot(self.base, frame, stamp_ns).covariance
        return covariance if covariance is not None and covariance.any() else None

    def site_pose(self, frame: str) -> FloatArray | None:
        """Return ``T_site_frame`` (4, 4); None if the frame is unknown or in the tree of the base."""
        is_known = frame in ("site", self.base) or frame in self._graph.frames
        return self.fixed("site", frame).matrix if is_known and not self.is_on_robot(frame) else None

    def fixed(self, parent: str, child: str) -> UncertainTransform:
        """Return ``T_parent_child`` of two frames in the tree of the site."""
        return UncertainTransform.identity() if parent == child else self._graph.lookup(parent, child, 0)

    def on_robot(self, parent: str, child: str, stamp_ns: int) -> UncertainTransform:
        """Return ``T_parent_child`` of two frames in the tree of the base; raises ExtrapolationError."""
        return (
            UncertainTransform.identity() if parent == child else self._graph.lookup(parent, child, stamp_ns)
        )

    def set_joints(self, joints: Joints, stamp_ns: int, oldest_ns: int, pins_ns: Iterable[int] = ()) -> None:
        """Insert values of joints at a time; remove values before ``oldest_ns`` except around pins.

        Raises InputError if a joint is not movable in the URDF, or a value outside its limits.
        """
        values = {name: state.position for name, state in zip(joints.names, joints.elements, strict=True)}
        unknown = sorted(set(values) - set(self._joints))
        if unknown:
            movable_names = ", ".join(self.movable_joints) or "none"
            raise InputError(f"joint {unknown[0]!r} is not movable in the URDF; movable are {movable_names}")
        for name, (track, joint) in self._joints.items():
            value = values.get(name)
            if joint.mimic is not None and joint.mimic[0] in values:
                value = values[joint.mimic[0]] * joint.mimic[1] + joint.mimic[2]
            if value is None:
                continue
            self._set(name, stamp_ns, value)
            track.evict_before(oldest_ns, pins_ns)
            # Old values are removed in blocks, since this copies all others.
            if len(self._values[name]) > 2 * len(track.poses) + 64:
                self._values[name] = {t: self._values[name][t] for t in track.stamps_ns}

    def joint_values(self) -> dict[str, JointValues]:
        """Return the values of each joint that has moved."""
        values_of = {}
        for name, (track, _) in self._joints.items():
            if track.stamps_ns:
                values = [self._values[name][t] for t in track.stamps_ns]
                values_of[name] = JointValues(
                    np.array(track.stamps_ns, dtype=np.int64), np.array(values), set(track.gap_ends)
                )
        return values_of

    def restore(self, joints: Mapping[str, JointValues]) -> None:
        """Insert stored values; joints missing in the URDF and values outside its limits are skipped."""
        for name, joint in joints.items():
            if name not in self._joints:
                continue
            for stamp_ns, value in zip(joint.stamps_ns.tolist(), joint.values.tolist(), strict=True):
                try:
                    self._set(name, stamp_ns, value)
                except InputError:
                    continue
            track = self._joints[name][0]
            track.gap_ends = {t for t in joint.gaps_ns if t in track.poses}

    def _set(self, name: str, stamp_ns: int, value: float) -> None:
        track, joint = self._joints[name]
        low, high = joint.limits or (-np.inf, np.inf)
        if not low - 1e-6 <= value <= high + 1e-6:
            raise InputError(f"joint {name!r}: {value:.6g}, expected {low:.6g} to {high:.6g}")
        track.insert(stamp_ns, UncertainTransform.exact(joint.transform(value)))
        self._values[name][stamp_ns] = value

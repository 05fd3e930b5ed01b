# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transform between any two frames, each at its own time."""

from __future__ import annotations

from cdff_common.errors import ProductNotFoundError
from cdff_common.geometry import UncertainTransform
from cdff_common.types import PoseTrajectory, TransformWithCovariance
from cdff_core.dfpcs.position_manager.estimate import Estimate
from cdff_core.dfpcs.position_manager.frame_tree import RobotFrames
from cdff_core.dfpcs.position_manager.measurement_history import MeasurementHistory
from cdff_core.dfpcs.position_manager.pose_timeline import PoseTimeline, to_trajectory


class TransformQuery:
    """Connects the frame trees of site and robot through the timeline of poses."""

    def __init__(
        self,
        frames: RobotFrames,
        timeline: PoseTimeline,
        history: MeasurementHistory,
        extrapolation_s: float,
        producer: str,
    ) -> None:
        self._frames, self._timeline, self._history = frames, timeline, history
        self._extrapolation_ns, self._producer = int(extrapolation_s * 1e9), producer
        #: ``T_odom_base`` at the start of the timeline.
        self.T_odom_base = UncertainTransform.identity()

    def get_transform(
        self, parent: str, parent_t_ns: int, child: str, child_t_ns: int
    ) -> TransformWithCovariance:
        """Return ``T_parent(t1)_child(t2)``, stamped with the child's time; -1 is the newest time.

        Raises FrameNotFoundError for an unknown frame, ExtrapolationError for a time outside the timeline by
        more than the limit, or removed from it.
        """
        newest_ns = self._newest_ns()
        t1_ns, t2_ns = (newest_ns if t < 0 else t for t in (parent_t_ns, child_t_ns))
        T = self._transform(parent, t1_ns, child, t2_ns)
        return TransformWithCovariance.from_transform(
            T, parent=parent, child=child, stamp_ns=t2_ns // 1000 * 1000, producer=self._producer
        )

    def get_trajectory(self, t0_ns: int, t1_ns: int) -> PoseTrajectory:
        """Return ``T_site_base`` at the estimates between two times; raises ExtrapolationError."""
        self._history.refresh()
        return self._timeline.trajectory(t0_ns, t1_ns, self._frames.base, self._producer)

    def pin(self, t_ns: int) -> TransformWithCovariance:
        """Keep the pose at a time permanently; raises ExtrapolationError if it is not in the timeline."""
        t_ns = self._newest_ns() if t_ns < 0 else t_ns // 1000 * 1000
        pose = self.get_transform("site", t_ns, self._frames.base, t_ns)
        self._timeline.pins.add(t_ns)
        return pose

    def unpin(self, t_ns: int) -> None:
        """Release a pinned time; raises ProductNotFoundError if it is not pinned."""
        t_ns, pins = t_ns // 1000 * 1000, self._timeline.pins
        if t_ns not in pins:
            raise ProductNotFoundError(f"t={t_ns} is not pinned; pinned are {sorted(pins) or 'none'}")
        pins.remove(t_ns)

    def get_pins(self) -> PoseTrajectory:
        """Return ``T_site_base`` at the pinned times."""
        stamps = sorted(self._timeline.pins)
        return to_trajectory(stamps, [self._pose(t) for t in stamps], self._frames.base, self._producer)

    def _newest_ns(self) -> int:
        """Return the newest time in whole microseconds; 0 before the start."""
        self._history.refresh()
        return self._timeline.stamps_ns[-1] // 1000 * 1000 if self._timeline.stamps_ns else 0

    def _pose(self, t_ns: int) -> UncertainTransform:
        return self._timeline.pose_at(t_ns, self._predict(t_ns))

    def _transform(self, parent: str, parent_t_ns: int, child: str, child_t_ns: int) -> UncertainTransform:
        """Return ``T_parent_child`` of two frames at two times, through the base of the robot."""
        f = self._frames
        parent_moves, child_moves = f.is_on_robot(parent), f.is_on_robot(child)
        if not parent_moves and not child_moves:
            return f.fixed(parent, child)
        if not parent_moves:
            T_base_child = f.on_robot(f.base, child, child_t_ns)
            if parent == f.odom:
                # The error of the site's anchor is part of every pose but not of the motion since the start.
                start_ns = next(iter(self._timeline.stamps_ns), child_t_ns)
                return self.T_odom_base @ self._motion(start_ns, child_t_ns) @ T_base_child
            return f.fixed(parent, "site") @ self._pose(child_t_ns) @ T_base_child
        if not child_moves:
            return self._transform(child, child_t_ns, parent, parent_t_ns).inverse()
        if parent_t_ns == child_t_ns:
            return f.on_robot(parent, child, child_t_ns)
        T_parent_base = f.on_robot(parent, f.base, parent_t_ns)
        return T_parent_base @ self._motion(parent_t_ns, child_t_ns) @ f.on_robot(f.base, child, child_t_ns)

    def _motion(self, start_ns: int, end_ns: int) -> UncertainTransform:
        return self._timeline.motion(start_ns, end_ns, self._predict(max(start_ns, end_ns)))

    def _predict(self, stamp_ns: int) -> Estimate | None:
        return self._history.extrapolate(stamp_ns, self._extrapolation_ns)

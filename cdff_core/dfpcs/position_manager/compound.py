# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""PositionManager: frame tree and time line of a robot, from all that says how it moves and where it is."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from cdff_common.errors import ExtrapolationError, InputError, ProductNotFoundError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import PoseTrajectory, PositionState, TransformWithCovariance
from cdff_core.dfpcs.position_manager._interface import PositionManagerInterface
from cdff_core.dfpcs.position_manager.buffers import ImuBuffer
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.drivers import Drivers
from cdff_core.dfpcs.position_manager.estimate import Estimate
from cdff_core.dfpcs.position_manager.estimator import Estimator, Event
from cdff_core.dfpcs.position_manager.frames import RobotFrames
from cdff_core.dfpcs.position_manager.history import History
from cdff_core.dfpcs.position_manager.kept import from_message, to_message
from cdff_core.dfpcs.position_manager.mission_time import MissionTime
from cdff_core.dfpcs.position_manager.questions import Questions
from cdff_core.dfpcs.position_manager.start import begin
from cdff_core.dfpcs.position_manager.time_line import TimeLine

_NS = 1e9


class PositionManager(PositionManagerInterface):
    """One time line ``T_site_base``, corrected backwards as far as late measurements reach."""

    Config = PositionManagerConfig
    config: PositionManagerConfig

    def setup(self) -> None:
        """Grow the frame tree, make the DFNs, offer the store."""
        c, context = self.config, self.context
        self._frames = RobotFrames(context.robot, context.frames, context.urdf)
        self._imu = ImuBuffer(int(2 * c.memory_s * _NS))
        self._levelling = self.dfn("levelling")
        self._estimator = Estimator(c, self.dfn, self._imu, self._mount, self._place)
        self._line = TimeLine(self.dfn("interpolation"), int(c.blind_s * _NS))
        self._time = MissionTime(c)
        self._drivers = Drivers(c)
        self._history: History | None = None
        self._start = UncertainTransform.identity()
        self._start_reasons: tuple[str, ...] = ()
        self._held: list[Sample] = []
        self._R_base_imu: FloatArray | None = None
        self._wheels_ns = -(1 << 62)
        self._published_ns = -1
        self._trajectory_ns = self._thinned_ns = 0
        self._questions = Questions(self._frames, self._line, self._ahead)
        self.store.offer("trajectory", lambda: self.get_trajectory(-1, -1) if self._history else None)
        self.store.offer("pose", lambda: self.get_pose("site", self._frames.base, -1) if self._history else None)
        self.store.offer("pins", lambda: self.get_pins() if self._line.pins else None)

    # -- input ----------------------------------------------------------------------------------------------------

    def step(self, sample: Sample) -> Iterator[Output]:
        """Take a sample, unless its time is doubtful; begin anew where the mission clock went back."""
        arrival = self._time.take(sample)
        for refused in arrival.refused:
            self._drivers.refuse(refused.port)
        if arrival.back or (arrival.ahead and self._history is None):
            time = self._time
            self.reset()
            self._time = time
            self.state_revision += 1
        for taken in arrival.taken:
            yield from super().step(taken)

    def on_imu(self, sample: Sample) -> Iterable[Output]:
        """Keep the reading in the base's axes; estimate by it alone where nothing else speaks."""
        if self._R_base_imu is None:
            T = self._frames.on_robot(self._frames.base, f"{self.context.robot}/imu", sample.stamp_ns).matrix
            self._R_base_imu, self._estimator.lever_m = T[:3, :3], T[:3, 3]
        reading = np.concatenate([self._R_base_imu @ sample.value.acc, self._R_base_imu @ sample.value.gyro])
        self._imu.insert(sample.stamp_ns, reading)
        if self._history is None:
            yield from self._hold(sample)
            return
        history = self._begun()
        history.doubt(sample.stamp_ns)
        if sample.stamp_ns - self._line.stamps_ns[-1] >= self.config.imu_period_s * _NS:
            yield from self._take(sample, Event(sample.stamp_ns, "imu"))

    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Take the increment of the wheels, unless they speak faster than it helps."""
        if self._history is None:
            yield from self._hold(sample)
            return
        since_ns = sample.stamp_ns - self._wheels_ns
        if 0 <= since_ns < self.config.wheel_period_s * _NS:
            return
        self._wheels_ns = max(self._wheels_ns, sample.stamp_ns)
        yield from self._take(sample, self._event(sample))

    def on_visual_odometry(self, sample: Sample) -> Iterable[Output]:
        """Take the increment of visual odometry."""
        yield from self._on_odometer(sample)

    def on_lidar_odometry(self, sample: Sample) -> Iterable[Output]:
        """Take the increment of lidar odometry."""
        yield from self._on_odometer(sample)

    def on_fix(self, sample: Sample) -> Iterable[Output]:
        """Take an absolute pose."""
        if self._history is None:
            yield from self._hold(sample)
        elif sample.value is not None and sample.quality.status is not Status.FAILED:
            yield from self._take(sample, self._event(sample))

    def on_absolute_fix(self, sample: Sample) -> Iterable[Output]:
        """Take an absolute pose of a second source."""
        yield from self.on_fix(sample)

    def on_joints(self, sample: Sample) -> Iterable[Output]:
        """Move the frames below the base."""
        forget_ns = sample.stamp_ns - int(self.config.history_s * _NS)
        self._frames.set_joints(sample.value, sample.stamp_ns, forget_ns, self._line.pins)
        self.state_revision += 1
        return ()

    def finish(self) -> Iterable[Output]:
        """Start with what there is where the input was short; then the whole trajectory."""
        if self._history is None and self._held:
            yield from self._start_line()
        if self._history is not None:
            self._history.refresh()
            yield self._trajectory(())

    # -- operations -----------------------------------------------------------------------------------------------

    def get_pose(self, parent: str, child: str, t_ns: int) -> TransformWithCovariance:
        """``T_parent_child``; raises FrameNotFoundError, or ExtrapolationError outside the time line."""
        return self.get_transform(parent, t_ns, child, t_ns)

    def get_transform(self, parent: str, parent_t_ns: int, child: str, child_t_ns: int) -> TransformWithCovariance:
        """``T_parent(t1)_child(t2)``; stamped with the child's time.

        Raises
        ------
        FrameNotFoundError
            If a frame is unknown.
        ExtrapolationError
            If a time lies outside the time line by more than ``extrapolation_s``, or was forgotten.
        """
        newest_ns = self._newest_ns()
        times = [newest_ns if t < 0 else t for t in (parent_t_ns, child_t_ns)]
        T = self._questions.transform(parent, times[0], child, times[1], self._start)
        return TransformWithCovariance.from_transform(
            T, parent=parent, child=child, stamp_ns=times[1] // 1000 * 1000, producer=self.name
        )

    def get_trajectory(self, t0_ns: int, t1_ns: int) -> PoseTrajectory:
        """``T_site_base`` at every estimate kept between two times; raises ExtrapolationError where there is none."""
        self._newest_ns()
        nodes = [
            n for n in self._line.nodes if (t0_ns < 0 or n.stamp_ns >= t0_ns) and (t1_ns < 0 or n.stamp_ns <= t1_ns)
        ]
        if not nodes:
            raise ExtrapolationError(f"trajectory from {t0_ns} to {t1_ns}: no estimate lies there")
        return PoseTrajectory.from_arrays(
            np.array([n.stamp_ns for n in nodes]) // 1000 * 1000,
            np.array([n.pose for n in nodes]),
            np.array([n.covariance[:6, :6] for n in nodes]),
            parent="site",
            child=self._frames.base,
            producer=self.name,
        )

    def pin(self, t_ns: int) -> TransformWithCovariance:
        """Keep a time; raises ExtrapolationError where it is not in the time line."""
        t_ns = self._newest_ns() if t_ns < 0 else t_ns // 1000 * 1000
        pose = self.get_pose("site", self._frames.base, t_ns)
        self._line.pins.add(t_ns)
        self.state_revision += 1
        return pose

    def unpin(self, t_ns: int) -> None:
        """Let a time go; raises ProductNotFoundError where it is not pinned."""
        t_ns = t_ns // 1000 * 1000
        if t_ns not in self._line.pins:
            raise ProductNotFoundError(f"t={t_ns} is not pinned; pinned are {sorted(self._line.pins) or 'none'}")
        self._line.pins.remove(t_ns)
        self.state_revision += 1

    def get_pins(self) -> PoseTrajectory:
        """``T_site_base`` at the pinned times."""
        stamps = sorted(self._line.pins)
        poses = [self._questions.at(t) for t in stamps]
        return PoseTrajectory.from_arrays(
            stamps,
            np.array([p.matrix for p in poses]).reshape(-1, 4, 4),
            np.array([p.covariance for p in poses]).reshape(-1, 6, 6),
            parent="site",
            child=self._frames.base,
            producer=self.name,
        )

    # -- what survives a restart ----------------------------------------------------------------------------------

    def state(self) -> PositionState | None:
        """Time line, pins, joints and the filter's newest estimate; None before the start."""
        if self._history is None:
            return None
        gravity, joints = self._estimator.gravity_m_s2, self._frames.joint_values()
        newest = self._history.newest
        return to_message(self._line, newest, self._start, gravity, joints, self._frames.base, self.name)

    def resume(self, state: Any) -> None:
        """Go on where the state ends; wheels that counted on bridge the time in between.

        Raises
        ------
        InputError
            If the state is no PositionState, or its parts do not fit together.
        """
        if not isinstance(state, PositionState):
            raise InputError(f"{self.name}: state of type {type(state).__name__}, expected PositionState")
        kept = from_message(state)
        self.reset()
        self._line.nodes, self._line.stamps_ns = kept.nodes, [n.stamp_ns for n in kept.nodes]
        self._line.pins |= kept.pins
        self._frames.restore(kept.joints)
        self._start, self._estimator.gravity_m_s2 = kept.start, kept.gravity_m_s2
        self._history = History(self._estimator, kept.estimate, self._line, int(self.config.memory_s * _NS))
        self._published_ns = self._trajectory_ns = self._thinned_ns = kept.estimate.stamp_ns
        self._drivers.begin(kept.estimate.stamp_ns)
        self._time.begin(kept.estimate.stamp_ns)
        self._start_reasons = ("resumed",)

    # -- control --------------------------------------------------------------------------------------------------

    def _hold(self, sample: Sample) -> Iterator[Output]:
        """Keep a sample until the start pose can be levelled or the wait is over."""
        self._held.append(sample)
        waited_ns = sample.stamp_ns - self._held[0].stamp_ns
        if self._imu.span_ns >= self.config.levelling_s * _NS or waited_ns >= self.config.start_wait_s * _NS:
            yield from self._start_line()

    def _start_line(self) -> Iterator[Output]:
        """Begin the line at the first pose that was held, then take what was held."""
        held, self._held = self._held, []
        poses = [s for s in held if s.port != "imu" and s.value is not None] or held[:1]
        wheels = next((s.value.transform for s in held if s.port == "odometry"), UncertainTransform.identity())
        anchor = self._frames.fixed("site", self._frames.odom)
        start = begin(min(s.stamp_ns for s in poses), anchor, wheels, self._imu, self._levelling, self.config)
        self._start, self._start_reasons = start.T_odom_base, start.reasons
        self._estimator.gravity_m_s2 = start.gravity_m_s2
        self._history = History(self._estimator, start.estimate, self._line, int(self.config.memory_s * _NS))
        self._trajectory_ns = self._thinned_ns = start.estimate.stamp_ns
        self._drivers.begin(start.estimate.stamp_ns)
        for sample in held:
            if sample.port != "imu":
                yield from self.step(sample)

    def _on_odometer(self, sample: Sample) -> Iterator[Output]:
        """Visual and lidar odometry alike; one that FAILED leaves the next increment without a begin."""
        if self._history is None:
            yield from self._hold(sample)
        elif sample.value is None or sample.quality.status is Status.FAILED:
            self._drivers.lose(sample.port)
        else:
            yield from self._take(sample, self._event(sample, afresh=self._drivers.lost(sample.port)))

    def _event(self, sample: Sample, *, afresh: bool = False) -> Event:
        value: TransformWithCovariance = sample.value
        child = "" if sample.port == "odometry" else value.child_frame
        scale = self._drivers.scale(sample)
        return Event(sample.stamp_ns, sample.port, value.transform, value.parent_frame, child, scale, afresh)

    def _take(self, sample: Sample, event: Event) -> Iterator[Output]:
        """Put a measurement in its place, run again from there, publish."""
        history = self._begun()
        if not history.reaches(event.stamp_ns):
            self._drivers.refuse(sample.port)
            return
        verdict = history.insert(event)
        self._drivers.judge(event, verdict)
        self.state_revision += 1
        if self._drivers.speaks(event, self._line.stamps_ns[-1]):
            yield from self._publish(sample, verdict.reasons)

    def _publish(self, sample: Sample, reasons: tuple[str, ...]) -> Iterator[Output]:
        """The pose at the sample's time, unless a later one is out already; the trajectory when it is due."""
        t_ns = sample.stamp_ns
        if t_ns <= self._published_ns:
            return
        self._published_ns = t_ns
        T = self._line.at(t_ns)
        base, inputs = self._frames.base, (sample.id,) if sample.id else ()
        value = TransformWithCovariance.from_transform(
            T, parent="site", child=base, stamp_ns=t_ns // 1000 * 1000, producer=self.name
        )
        quality = self._drivers.quality(t_ns, T, (*reasons, *self._start_reasons))
        yield Output("pose", value, t_ns, t_ns, "site", base, quality, inputs)
        c = self.config
        if t_ns - self._thinned_ns >= c.trajectory_period_s * _NS:
            self._thinned_ns = t_ns
            dense_ns = min(t_ns - int(c.dense_s * _NS), self._begun().oldest_ns)
            self._line.thin(dense_ns, int(c.thin_s * _NS), t_ns - int(c.history_s * _NS))
        kept_s = min((t_ns - self._line.stamps_ns[0]) / _NS, c.history_s)
        if t_ns - self._trajectory_ns >= max(c.trajectory_period_s, c.trajectory_share * kept_s) * _NS:
            self._trajectory_ns = t_ns
            yield self._trajectory(inputs)

    def _trajectory(self, inputs: tuple[str, ...]) -> Output:
        """The time line so far."""
        value = self.get_trajectory(-1, -1)
        stamps = value.stamps_ns
        degraded = self._drivers.degraded
        quality = Quality(
            Status.DEGRADED if degraded else Status.OK,
            ("source:wheels_at_times",) if degraded else (),
            CovarianceKind.FORMAL,
            {"poses": float(len(stamps)), "degraded_poses": float(degraded)},
        )
        return Output("trajectory", value, int(stamps[0]), int(stamps[-1]), "site", self._frames.base, quality, inputs)

    # -- what the parts ask ---------------------------------------------------------------------------------------

    def _begun(self) -> History:
        assert self._history is not None  # the caller has looked
        return self._history

    def _newest_ns(self) -> int:
        if self._history is not None:
            self._history.refresh()
        return self._line.stamps_ns[-1] // 1000 * 1000 if self._line.stamps_ns else 0

    def _ahead(self, stamp_ns: int) -> Estimate | None:
        """An estimate of a time within ``extrapolation_s`` beyond the newest, by the IMU; None inside the line."""
        if self._history is None:
            return None
        newest = self._history.newest
        if not 0 < stamp_ns - newest.stamp_ns <= self.config.extrapolation_s * _NS:
            return None
        return self._estimator.ahead(newest, stamp_ns)

    def _mount(self, child: str, stamp_ns: int) -> FloatArray:
        return self._frames.on_robot(self._frames.base, child, stamp_ns).matrix

    def _place(self, frame: str) -> FloatArray | None:
        if not self._frames.knows(frame) or self._frames.moves(frame):
            return None
        return self._frames.fixed("site", frame).matrix

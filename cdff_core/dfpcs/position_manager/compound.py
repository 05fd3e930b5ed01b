# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""PositionManager: frame tree and time line of a robot, moved on by increments of the better source."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from cdff_common.errors import DegenerateGeometryError, ExtrapolationError, RefusedError
from cdff_common.geometry import FrameGraph, PoseTrack, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcConfig, Output, Sample
from cdff_common.interfaces.product import CovarianceKind, Quality, Status
from cdff_common.types import PoseTrajectory, TransformWithCovariance
from cdff_core.dfns.gravity_levelling._interface import GravityLevellingInputs
from cdff_core.dfns.gyro_integration._interface import GyroIntegrationInputs
from cdff_core.dfns.odometry_increment._interface import OdometryIncrementInputs
from cdff_core.dfpcs.position_manager._interface import PositionManagerInterface
from cdff_core.dfpcs.position_manager.buffers import ImuBuffer

Seconds = Annotated[float, Field(gt=0, le=86_400)]
#: Drivers of the newest pose, as they stand in the reasons.
START, VISUAL, WHEELS, NOTHING = "source:start", "source:vo", "source:wheels", "source:none"


class PositionManagerConfig(DfpcConfig):
    """Parameters of PositionManager."""

    levelling: dict[str, Any] = Field(default_factory=dict)
    visual_increment: dict[str, Any] = Field(default_factory=dict)
    wheel_increment: dict[str, Any] = Field(default_factory=dict)
    gyro: dict[str, Any] = Field(default_factory=dict)
    levelling_s: Annotated[Seconds, Field(description="IMU readings that level the start pose")] = 0.5
    start_wait_s: Annotated[Seconds, Field(description="longest wait for those readings")] = 1.0
    start_tilt_sigma_rad: Annotated[
        float, Field(ge=0, le=1, description="roll, pitch of a start that is not levelled")
    ] = 0.05
    visual_timeout_s: Annotated[Seconds, Field(description="silence after which the wheels are published")] = 1.2
    visual_gap_s: Annotated[Seconds, Field(description="longest interval whose visual increment is taken")] = 2.0
    disagreement_m: Annotated[float, Field(ge=0, description="gate between visual and wheel increments")] = 0.25
    disagreement_share: Annotated[float, Field(ge=0, description="the gate's part that grows with the motion")] = 0.5
    unseen_speed_m_s: Annotated[float, Field(ge=0, le=10, description="sigma of a motion nobody measured")] = 0.3
    max_wheel_speed_m_s: Annotated[float, Field(gt=0, le=100, description="beyond it the wheels' origin was reset")] = (
        5.0
    )
    memory_s: Annotated[Seconds, Field(description="wheel poses and gyro rates kept")] = 20.0
    history_s: Annotated[Seconds, Field(description="time line kept")] = 7200.0
    trajectory_period_s: Seconds = 5.0
    extrapolation_s: Annotated[
        float, Field(ge=0, le=10, description="how far beyond its ends the time line answers")
    ] = 0.2


class PositionManager(PositionManagerInterface):
    """One time line ``T_odom_base``; the site's anchor and the sensors' mounts are the frames around it."""

    Config = PositionManagerConfig
    config: PositionManagerConfig

    def setup(self) -> None:
        """Copy the fixed frames, make the DFNs, offer the store."""
        robot, c = self.context.robot, self.config
        self._odom, self._base = f"{robot}/odom", f"{robot}/base"
        self._levelling = self.dfn("levelling")
        self._visual_increment = self.dfn("visual_increment")
        self._wheel_increment = self.dfn("wheel_increment")
        self._gyro = self.dfn("gyro")
        self._frames = _fixed_frames(self.context.frames, self._odom)
        self._line = self._frames.track(self._odom, self._base, int(c.extrapolation_s * 1e9))
        self._wheels = PoseTrack()
        self._imu = ImuBuffer(int(c.memory_s * 1e9))
        self._R_base_imu: np.ndarray | None = None
        self._gyro_bias = np.zeros(3)
        self._held: list[Sample] = []
        self._started = False
        self._start_reasons: tuple[str, ...] = ()
        self._visual: tuple[int, UncertainTransform] | None = None
        self._awaiting: tuple[Sample, UncertainTransform, tuple[str, ...]] | None = None
        self._visual_ns = 0
        self._published_ns = -1
        self._trajectory_ns = 0
        self._degraded = 0
        self.store.offer("trajectory", lambda: self.get_trajectory(-1, -1) if self._line.stamps_ns else None)
        self.store.offer("pose", lambda: self.get_pose("site", self._base, -1) if self._line.stamps_ns else None)

    def on_imu(self, sample: Sample) -> Iterable[Output]:
        """Keep the reading in the body's axes; the start waits for enough of them."""
        if self._R_base_imu is None:
            self._R_base_imu = self._frames.lookup(self._base, f"{self.context.robot}/imu", 0).matrix[:3, :3]
        R = self._R_base_imu
        self._imu.append(sample.stamp_ns, R @ np.asarray(sample.value.acc), R @ np.asarray(sample.value.gyro))
        if not self._started:
            yield from self._hold(sample)

    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Keep the wheel pose and move the end of the time line on by it."""
        if not self._started:
            yield from self._hold(sample)
            return
        self._take_wheels(sample.stamp_ns, sample.value.transform)
        self._wheels.forget_before(sample.stamp_ns - int(self.config.memory_s * 1e9))
        if self._awaiting is not None and sample.stamp_ns >= self._awaiting[0].stamp_ns:
            yield from self._attach(*self._awaiting)
        self._follow_wheels()
        silent_ns = sample.stamp_ns - self._visual_ns
        if silent_ns > self.config.visual_timeout_s * 1e9 and self._line.stamps_ns[-1] == sample.stamp_ns:
            self._visual = None
            yield from self._publish(sample, WHEELS)

    def on_visual_odometry(self, sample: Sample) -> Iterable[Output]:
        """Move the time line on by the increment since the visual pose before, or attach to it anew."""
        if not self._started:
            yield from self._hold(sample)
            return
        if self._awaiting is not None:
            yield from self._attach(*self._awaiting)
        if sample.value is None or sample.quality.status is Status.FAILED:
            self._visual = None
            return
        pose = sample.value.transform
        before, self._visual = self._visual, (sample.stamp_ns, pose)
        if before is None or not 0 < sample.stamp_ns - before[0] <= self.config.visual_gap_s * 1e9:
            yield from self._attach(sample, pose, ("vo_attached",))
            return
        mount = self._frames.lookup(self._base, sample.value.child_frame, 0).matrix
        step = self._visual_increment.process(
            OdometryIncrementInputs(before[1].matrix, pose.matrix, mount, before[1].covariance, pose.covariance)
        )
        wheels = self._wheel_step(before[0], sample.stamp_ns)
        if wheels is not None and self._disagrees(step.increment, wheels.matrix):
            yield from self._attach(sample, pose, ("vo_disagrees_with_wheels",))
            return
        if wheels is not None and sample.quality.status is Status.DEGRADED:
            yield from self._attach(sample, pose, ("vo_degraded",))
            return
        here = self._line.at(before[0]) @ UncertainTransform(step.increment, step.covariance)
        self._line.forget_after(before[0])
        self._line.insert(sample.stamp_ns, here)
        self._visual_ns = sample.stamp_ns
        self._follow_wheels()
        degraded = ("vo_degraded",) if sample.quality.status is Status.DEGRADED else ()
        yield from self._publish(sample, VISUAL, degraded)

    def finish(self) -> Iterable[Output]:
        """Start with what there is where the input was short; then the whole trajectory."""
        if not self._started and self._held:
            yield from self._start()
        if self._awaiting is not None:
            yield from self._attach(*self._awaiting)
        if self._line.stamps_ns:
            yield self._trajectory(())

    def get_pose(self, parent: str, child: str, t_ns: int) -> TransformWithCovariance:
        """``T_parent_child``, interpolated.

        Raises
        ------
        FrameNotFoundError
            If a frame is unknown.
        ExtrapolationError
            If the time lies outside the time line by more than ``extrapolation_s``.
        """
        if t_ns < 0:
            t_ns = self._line.stamps_ns[-1] if self._line.stamps_ns else 0
        T = self._frames.lookup(parent, child, t_ns)
        return TransformWithCovariance.from_transform(
            T, parent=parent, child=child, stamp_ns=t_ns // 1000 * 1000, producer=self.name
        )

    def get_trajectory(self, t0_ns: int, t1_ns: int) -> PoseTrajectory:
        """``T_site_base`` at every estimate between two times; raises ExtrapolationError where there is none."""
        stamps = [t for t in self._line.stamps_ns if (t0_ns < 0 or t >= t0_ns) and (t1_ns < 0 or t <= t1_ns)]
        if not stamps:
            raise ExtrapolationError(f"trajectory from {t0_ns} to {t1_ns}: no estimate lies there")
        anchor = self._frames.lookup("site", self._odom, 0)
        poses = [anchor @ self._line.poses[t] for t in stamps]
        unknown = np.full((6, 6), np.nan)
        return PoseTrajectory.from_arrays(
            np.array(stamps),
            np.array([p.matrix for p in poses]),
            np.array([unknown if p.covariance is None else p.covariance for p in poses]),
            parent="site",
            child=self._base,
        )

    def _hold(self, sample: Sample) -> Iterator[Output]:
        """Keep a sample until the start pose can be levelled or the wait is over."""
        self._held.append(sample)
        waited_ns = sample.stamp_ns - self._held[0].stamp_ns
        if self._imu.span_ns >= self.config.levelling_s * 1e9 or waited_ns >= self.config.start_wait_s * 1e9:
            yield from self._start()

    def _start(self) -> Iterator[Output]:
        """Set the start pose at the first pose that was held, then take what was held."""
        held, self._held = self._held, []
        poses = [s for s in held if s.port != "imu"] or held[:1]
        start_ns = min(s.stamp_ns for s in poses)
        wheels = next((s.value.transform for s in held if s.port == "odometry"), UncertainTransform.identity())
        self._line.insert(start_ns, self._levelled(wheels))
        self._started = True
        self._visual_ns = start_ns
        self._trajectory_ns = start_ns
        for sample in held:
            if sample.port != "imu":
                yield from self.step(sample)

    def _levelled(self, wheels: UncertainTransform) -> UncertainTransform:
        """``T_odom_base`` at the start: position and heading the wheels count, roll and pitch against gravity."""
        forces, rates = self._imu.until(self._imu.stamps_ns[-1] if self._imu.stamps_ns else 0)
        tilt, sigma = np.eye(3), np.diag([self.config.start_tilt_sigma_rad**2] * 2 + [0.0])
        try:
            level = self._levelling.process(GravityLevellingInputs(forces, rates))
        except (RefusedError, DegenerateGeometryError) as error:
            self._start_reasons = ("not_levelled", *error.reasons)
        else:
            tilt, sigma, self._gyro_bias = level.rotation, level.covariance, level.gyro_bias_rad_s
            self._start_reasons = () if bool(level.at_rest) else ("levelled_in_motion",)
        forward = wheels.matrix[:3, 0]
        turn = se3.exp_so3([0.0, 0.0, float(np.arctan2(forward[1], forward[0]))])
        covariance = np.zeros((6, 6)) if wheels.covariance is None else wheels.covariance.copy()
        covariance[3:5, :] = covariance[:, 3:5] = 0.0
        covariance[3:, 3:] += turn @ sigma @ turn.T
        return UncertainTransform(se3.transform(turn @ tilt, wheels.matrix[:3, 3]), covariance)

    def _attach(self, sample: Sample, pose: UncertainTransform, reasons: tuple[str, ...]) -> Iterator[Output]:
        """Bring the time line up to a visual pose without its help; the increments after it count from there."""
        t_ns = sample.stamp_ns
        self._visual = (t_ns, pose)
        self._follow_wheels()
        end_ns = self._line.stamps_ns[-1]
        source = WHEELS
        if t_ns > end_ns:
            step = self._wheel_step(end_ns, t_ns)
            wheels_ns = self._wheels.stamps_ns[-1] if self._wheels.stamps_ns else -1
            lively = wheels_ns >= t_ns - self.config.visual_timeout_s * 1e9
            if step is None and lively and self._awaiting is None:
                self._awaiting = (sample, pose, reasons)
                return
            source, step = (WHEELS, step) if step is not None else (NOTHING, self._unseen(t_ns - end_ns))
            here = self._line.at(end_ns) @ step
        else:
            here = self._line.at(t_ns)
            source = START if t_ns == self._line.stamps_ns[0] else WHEELS
        self._awaiting = None
        self._line.insert(t_ns, here)
        self._visual_ns = t_ns
        yield from self._publish(sample, source, reasons)

    def _take_wheels(self, stamp_ns: int, pose: UncertainTransform) -> None:
        """Keep a wheel pose; one that no wheel could have reached begins a new count."""
        if self._wheels.stamps_ns:
            last_ns = self._wheels.stamps_ns[-1]
            moved_m = float(np.linalg.norm(pose.matrix[:3, 3] - self._wheels.poses[last_ns].matrix[:3, 3]))
            if moved_m > self.config.max_wheel_speed_m_s * abs(stamp_ns - last_ns) * 1e-9:
                self._wheels = PoseTrack()
        self._wheels.insert(stamp_ns, pose)

    def _follow_wheels(self) -> None:
        """Move the end of the time line on by every wheel pose beyond it."""
        end_ns = self._line.stamps_ns[-1]
        if self._wheels.stamps_ns and end_ns < self._wheels.stamps_ns[0]:
            first_ns = self._wheels.stamps_ns[0]
            self._line.insert(first_ns, self._line.at(end_ns) @ self._unseen(first_ns - end_ns))
            end_ns = first_ns
        for t_ns in self._wheels.stamps_ns[bisect_right(self._wheels.stamps_ns, end_ns) :]:
            step = self._wheel_step(end_ns, t_ns)
            if step is not None:
                self._line.insert(t_ns, self._line.at(end_ns) @ step)
                end_ns = t_ns

    def _wheel_step(self, begin_ns: int, end_ns: int) -> UncertainTransform | None:
        """Motion between two times by the wheels, turned by the gyro where it was read; None outside their span."""
        try:
            first, second = self._wheels.at(begin_ns), self._wheels.at(end_ns)
        except ExtrapolationError:
            return None
        step = self._wheel_increment.process(
            OdometryIncrementInputs(first.matrix, second.matrix, np.eye(4), None, None)
        )
        T, covariance = step.increment.copy(), step.covariance.copy()
        stamps, rates = self._imu.around(begin_ns, end_ns)
        try:
            turned = self._gyro.process(
                GyroIntegrationInputs(stamps, rates, self._gyro_bias, np.array([begin_ns, end_ns]))
            )
        except RefusedError:
            return UncertainTransform(T, covariance)
        T[:3, :3] = turned.rotation
        covariance[3:, 3:] = turned.covariance
        return UncertainTransform(T, covariance)

    def _unseen(self, span_ns: int) -> UncertainTransform:
        sigma = self.config.unseen_speed_m_s * span_ns * 1e-9
        return UncertainTransform(np.eye(4), np.diag([sigma**2] * 6))

    def _disagrees(self, visual: np.ndarray, wheels: np.ndarray) -> bool:
        distance_m = float(np.linalg.norm(wheels[:3, 3]))
        apart_m = float(np.linalg.norm(visual[:3, 3] - wheels[:3, 3]))
        return apart_m > self.config.disagreement_m + self.config.disagreement_share * distance_m

    def _publish(self, sample: Sample, source: str, reasons: tuple[str, ...] = ()) -> Iterator[Output]:
        """The pose at the sample's time, unless a later one is out already; the trajectory when it is due."""
        t_ns = sample.stamp_ns
        if t_ns <= self._published_ns:
            return
        self._published_ns = t_ns
        T = self._frames.lookup("site", self._base, t_ns)
        value = TransformWithCovariance.from_transform(
            T, parent="site", child=self._base, stamp_ns=t_ns, producer=self.name
        )
        fine = source in (START, VISUAL) and "vo_degraded" not in reasons
        self._degraded += not fine
        sigma = np.zeros(6) if T.covariance is None else np.sqrt(np.diagonal(T.covariance))
        quality = Quality(
            Status.OK if fine else Status.DEGRADED,
            (source, *reasons, *self._start_reasons),
            CovarianceKind.NONE if T.covariance is None else CovarianceKind.FORMAL,
            {"sigma_position_m": float(np.linalg.norm(sigma[:3])), "visual_age_s": (t_ns - self._visual_ns) * 1e-9},
        )
        yield Output("pose", value, t_ns, t_ns, "site", self._base, quality, (sample.id,) if sample.id else ())
        if t_ns - self._trajectory_ns >= self.config.trajectory_period_s * 1e9:
            self._trajectory_ns = t_ns
            self._line.forget_before(t_ns - int(self.config.history_s * 1e9))
            yield self._trajectory((sample.id,) if sample.id else ())

    def _trajectory(self, inputs: tuple[str, ...]) -> Output:
        """The time line so far."""
        value = self.get_trajectory(-1, -1)
        stamps = value.stamps_ns
        quality = Quality(
            Status.DEGRADED if self._degraded else Status.OK,
            ("source:wheels_at_times",) if self._degraded else (),
            CovarianceKind.FORMAL,
            {"poses": float(len(stamps)), "degraded_poses": float(self._degraded)},
        )
        return Output("trajectory", value, int(stamps[0]), int(stamps[-1]), "site", self._base, quality, inputs)


def _fixed_frames(context: FrameGraph, odom: str) -> FrameGraph:
    """A copy of the robot's fixed frames, to which the moving edge can be added; without an anchor odom is the site."""
    frames = FrameGraph()
    for child in context.frames:
        parent = context.parent_of(child)
        if parent is not None:
            frames.set_static(parent, child, context.lookup(parent, child, 0))
    if odom not in frames.frames:
        frames.set_static("site", odom, UncertainTransform.identity())
    return frames

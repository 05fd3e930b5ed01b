# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of PositionManager: admit, initialise, estimate, publish; answer queries on the timeline."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.types import PoseTrajectory, PositionState, TransformWithCovariance
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.estimator import Estimator
from cdff_core.dfpcs.position_manager.filter_state import Checkpoint
from cdff_core.dfpcs.position_manager.frame_tree import RobotFrames
from cdff_core.dfpcs.position_manager.imu_buffer import ImuBuffer
from cdff_core.dfpcs.position_manager.initialisation import Initialiser, InitialState
from cdff_core.dfpcs.position_manager.interface import PositionManagerInterface
from cdff_core.dfpcs.position_manager.measurement import ODOMETRIES, Measurement
from cdff_core.dfpcs.position_manager.measurement_history import MeasurementHistory
from cdff_core.dfpcs.position_manager.mission_time import MissionTime
from cdff_core.dfpcs.position_manager.pose_timeline import PoseTimeline
from cdff_core.dfpcs.position_manager.publication import Publisher
from cdff_core.dfpcs.position_manager.source_monitor import SourceMonitor
from cdff_core.dfpcs.position_manager.time_offset import StampCorrection
from cdff_core.dfpcs.position_manager.transform_query import TransformQuery


class PositionManager(PositionManagerInterface):
    """Timeline of ``T_site_base``; a late measurement corrects all estimates after its time."""

    Config = PositionManagerConfig
    config: PositionManagerConfig

    def setup(self) -> None:
        """Create frame tree, filter and timeline; offer the store items."""
        c, t = self.config, self.config.timeline
        tree = self._frames = RobotFrames.of(self.context)
        self._imu = ImuBuffer(int(2 * t.memory_s * 1e9))
        self._estimator = Estimator(c, self.dfn, self._imu, tree)
        self._timeline = PoseTimeline(self.dfn("interpolation"), int(c.clock.max_silence_s * 1e9))
        history = self._history = MeasurementHistory(self._estimator, self._timeline, int(t.memory_s * 1e9))
        self._mission_time, self._sources = MissionTime(c), SourceMonitor(c)
        self.stamps = StampCorrection(self._imu, tree)
        self._initialiser = Initialiser(c, self.dfn("levelling"), self._imu, tree)
        self._query = TransformQuery(tree, self._timeline, history, t.extrapolation_s, self.name)
        self._publisher = Publisher(c, self._timeline, self._sources, tree.base, self.name)
        self.store.offer("trajectory", lambda: self.get_trajectory(-1, -1) if history.is_started else None)
        self.store.offer("pose", lambda: self.get_pose("site", tree.base, -1) if history.is_started else None)
        self.store.offer("pins", lambda: self.get_pins() if self._timeline.pins else None)

    def step(self, sample: Sample) -> Iterator[Output]:
        """Process a sample unless its stamp is implausible; reset if the mission clock jumped."""
        admission = self._mission_time.admit(sample)
        for refused in admission.refused:
            self._sources.count_refusal(refused.port)
        if admission.jumped_back or (admission.jumped_ahead and not self._history.is_started):
            mission_time = self._mission_time
            self.reset()
            self._mission_time = mission_time
            self.state_revision += 1
        for accepted in admission.accepted:
            yield from super().step(accepted)

    def on_imu(self, sample: Sample) -> Iterable[Output]:
        """Buffer the reading; estimate from the IMU alone if no other source has measured for a while."""
        if self._imu.T_base_imu is None:
            self._imu.T_base_imu = self._frames.mount(self._frames.imu, sample.stamp_ns)
        self._imu.insert(sample.stamp_ns, sample.value.acc, sample.value.gyro)
        if not self._history.is_started:
            yield from self._initialise(sample)
            return
        self._history.invalidate(sample.stamp_ns)
        if sample.stamp_ns - self._timeline.stamps_ns[-1] >= self.config.timeline.imu_period_s * 1e9:
            yield from self._estimate(sample, Measurement(sample.stamp_ns, "imu"))

    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Process a pose of the wheels; poses at a higher rate are skipped."""
        if not (self._history.is_started and self._sources.is_too_frequent(sample)):
            yield from self.on_visual_odometry(sample)

    def on_visual_odometry(self, sample: Sample) -> Iterable[Output]:
        """Process a pose of a placed sensor; after a FAILED pose the next increment is omitted."""
        if not self._history.is_started:
            yield from self._initialise(sample)
        elif sample.value is None or sample.quality.status is Status.FAILED:
            self._sources.mark_failed(sample.port)
        else:
            measurement = self._sources.measurement(sample, self._frames.base)
            if self._frames.is_placed(measurement.child, sample.stamp_ns):
                yield from self._estimate(sample, measurement)
            else:
                self._sources.mark_unplaced(sample.port, measurement.child)

    on_lidar_odometry = on_fix = on_absolute_fix = on_visual_odometry

    def on_joints(self, sample: Sample) -> Iterable[Output]:
        """Move the frames of the joints below the base."""
        oldest_ns = sample.stamp_ns - int(self.config.timeline.history_s * 1e9)
        self._frames.set_joints(sample.value, sample.stamp_ns, oldest_ns, self._timeline.pins)
        self.state_revision += 1
        return ()

    def finish(self) -> Iterable[Output]:
        """Start with the buffered samples if the input was too short for it; yield the whole trajectory."""
        if not self._history.is_started and self._initialiser.has_samples:
            yield from self._start()
        if self._history.is_started:
            self._history.refresh()
            yield self._publisher.trajectory()

    def get_pose(self, parent: str, child: str, t_ns: int) -> TransformWithCovariance:
        """Return ``T_parent_child`` at a time."""
        return self._query.get_transform(parent, t_ns, child, t_ns)

    def get_transform(
        self, parent: str, parent_t_ns: int, child: str, child_t_ns: int
    ) -> TransformWithCovariance:
        """Return the transform from the child at one time to the parent at another time."""
        return self._query.get_transform(parent, parent_t_ns, child, child_t_ns)

    def get_trajectory(self, t0_ns: int, t1_ns: int) -> PoseTrajectory:
        """Return ``T_site_base`` at the estimates between two times."""
        return self._query.get_trajectory(t0_ns, t1_ns)

    def pin(self, t_ns: int) -> TransformWithCovariance:
        """Keep the pose at a time permanently and return this ``T_site_base``."""
        self.state_revision += 1
        return self._query.pin(t_ns)

    def unpin(self, t_ns: int) -> None:
        """Release a pinned time."""
        self.state_revision += 1
        self._query.unpin(t_ns)

    def get_pins(self) -> PoseTrajectory:
        """Return ``T_site_base`` at the pinned times."""
        return self._query.get_pins()

    def state(self) -> PositionState | None:
        """Return timeline, pins, joints and the newest estimate of the filter; None before the start."""
        if not self._history.is_started:
            return None
        return Checkpoint(
            self._history.newest,
            self._timeline.nodes,
            self._timeline.pins,
            self._query.T_odom_base,
            self._estimator.gravity_m_s2,
            self._frames.joint_values(),
            self.stamps.applied_s,
        ).to_message(self._frames.base, self.name)

    def resume(self, state: Any) -> None:
        """Continue from a state; raises InputError if it is not a consistent PositionState."""
        if not isinstance(state, PositionState):
            raise InputError(f"{self.name}: state of type {type(state).__name__}, expected PositionState")
        stored = Checkpoint.from_message(state)
        self.reset()
        self._timeline.restore(stored.nodes, stored.pins)
        self._frames.restore(stored.joints)
        self.stamps.applied_s.update(stored.stamp_offsets_s)
        self._mission_time.start(stored.estimate.stamp_ns)
        self._publisher.published_ns = stored.estimate.stamp_ns
        self._start_from(InitialState(stored.estimate, stored.T_odom_base, stored.gravity_m_s2, ("resumed",)))

    def _initialise(self, sample: Sample) -> Iterator[Output]:
        """Buffer a sample; start if the start pose can be levelled or the waiting time is over."""
        if self._initialiser.add(sample):
            yield from self._start()

    def _start(self) -> Iterator[Output]:
        """Start at the first buffered pose, then process the buffered samples."""
        initial, samples = self._initialiser.finish()
        self._start_from(initial)
        for sample in samples:
            yield from self.step(sample)

    def _start_from(self, initial: InitialState) -> None:
        self._query.T_odom_base, self._estimator.gravity_m_s2 = initial.T_odom_base, initial.gravity_m_s2
        self._history.start(initial.estimate)
        self._sources.start(initial.estimate.stamp_ns)
        self._publisher.start(initial.estimate.stamp_ns, initial.reasons)

    def _estimate(self, sample: Sample, measurement: Measurement) -> Iterator[Output]:
        """Insert a measurement by its time, process it and all later ones, publish the pose."""
        if measurement.source in ODOMETRIES:
            measurement = self.stamps.corrected(measurement)
            sample = replace(sample, stamp_ns=measurement.stamp_ns)
        if measurement.stamp_ns < self._history.oldest.stamp_ns:
            self._sources.count_refusal(sample.port)
            return
        result = self._history.insert(measurement)
        self._sources.record(measurement, result)
        self.state_revision += 1
        if self._sources.is_published(measurement, self._timeline.stamps_ns[-1]):
            yield from self._publisher.publish(sample, result.reasons, self._history.oldest.stamp_ns)

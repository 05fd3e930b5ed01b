# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Controller of LidarSlam: track sweeps, build keyframes, close loops, publish poses and map."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from cdff_common.errors import FrameNotFoundError, InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import rotate_covariance
from cdff_common.interfaces.dfpc import Output, Sample
from cdff_common.interfaces.product import Status
from cdff_common.types import LidarMap, LidarScan, Pointcloud, PoseTrajectory
from cdff_core.dfpcs.lidar_slam.configuration import LidarSlamConfig
from cdff_core.dfpcs.lidar_slam.interface import LidarSlamInterface
from cdff_core.dfpcs.lidar_slam.keyframe_map import KeyframeMap
from cdff_core.dfpcs.lidar_slam.keyframe_mapper import KeyframeMapper
from cdff_core.dfpcs.lidar_slam.motion_predictor import MotionPredictor
from cdff_core.dfpcs.lidar_slam.products import ProductBuilder
from cdff_core.dfpcs.lidar_slam.relocaliser import Relocaliser
from cdff_core.dfpcs.lidar_slam.scan_tracker import ScanTracker, TrackingResult
from cdff_core.keyframe_graph.checkpoint_schedule import CheckpointSchedule


class LidarSlam(LidarSlamInterface):
    """Odometry by registration with a local map, and keyframes in a pose graph.

    In the frame ``{robot}/lidar_odom`` poses drift but never jump; in ``{robot}/slam``, the map frame, loop
    closures correct them. Both frames start at the first sweep with points within range.
    """

    Config = LidarSlamConfig
    config: LidarSlamConfig

    def setup(self) -> None:
        """Create the DFNs, clear the map, offer the store items."""
        self._mapper = KeyframeMapper(self, self.config)
        self._relocaliser = Relocaliser(self.config.loops.max_loop_candidates)
        self.forget()
        self.store.offer("map", self.state)
        self.store.offer("graph", lambda: self._products.graph() if len(self.keyframes) else None)
        self.store.offer("trajectory", lambda: self._products.stored_trajectory())  # noqa: PLW0108  replaced
        self.store.offer("cloud", lambda: self.get_map(0.0) if len(self.keyframes) else None)

    def forget(self) -> None:
        """Clear map and trajectory and start again."""
        self._tracker = self._new_tracker(MotionPredictor(self.config.prediction, self._T_base_lidar()))
        self._mapper.clear()
        self._relocaliser.clear()
        self._products = ProductBuilder(
            self.name,
            self.context.robot,
            self.context.sensor_frame("lidar", "lidar"),
            self.config.gates,
            self._mapper,
            self._relocaliser,
        )
        self._checkpoints = CheckpointSchedule()
        self.state_revision += 1

    @property
    def keyframes(self) -> KeyframeMap:
        """Keyframes and pose graph; read-only for callers."""
        return self._mapper.keyframes

    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Store the pose for the prediction of the following sweeps."""
        if sample.value is not None and sample.quality.status is not Status.FAILED:
            self._tracker.predictor.insert(sample.stamp_ns, sample.value.transform)
        return ()

    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Run the control sequence for one sweep."""
        tracking = self._tracker.track(sample.value)  # predict, register, deskew
        key = self._mapper.add_sweep(sample.stamp_ns, tracking)
        is_first_sweep = not len(self._mapper.trajectory)
        is_relocalised = self._relocaliser.update(self._mapper)
        if is_relocalised and is_first_sweep:
            tracking = self._restart_on_map(key, sample.value) or tracking
        is_keyframe_complete, is_loop_found = self._mapper.is_keyframe_complete, False
        if is_keyframe_complete:
            is_loop_found = self._mapper.complete_keyframe()  # detect, verify and optimise loops, merge
            self._mapper.start_keyframe(sample.stamp_ns)
        self._mapper.append_pose(sample.stamp_ns, tracking)
        self._update_checkpoint(is_keyframe_complete)
        yield from self._products.poses(sample.value, sample.id, tracking)
        if is_relocalised or is_loop_found or (is_keyframe_complete and self.config.report_keyframes):
            yield from self._products.reports(sample.stamp_ns)

    def on_map(self, sample: Sample) -> Iterable[Output]:
        """Import a map: an empty map is replaced by it; otherwise loop closures with it are searched."""
        keys = tuple(self._import(sample.value).values())
        if self.keyframes.root in keys:
            return ()
        self._mapper.connect(keys)
        return self._products.reports(max(sample.stamp_ns, self._products.newest_ns))

    def finish(self) -> Iterable[Output]:
        """Complete the last keyframe; publish trajectory, graph and cloud of the whole map."""
        if self._mapper.current is None:
            return
        self._mapper.update_cloud()
        self._mapper.close_loops(self._mapper.current, merge=False)
        yield from self._products.reports()
        yield self._products.cloud_output()

    def export_map(self) -> LidarMap:
        """Return the map and the position of the lidar; raises ProductNotFoundError without a map."""
        return self._products.lidar_map()

    def get_map(self, voxel_m: float) -> Pointcloud:
        """Return the clouds of all keyframes connected with the first one, thinned."""
        return self._products.cloud(voxel_m)

    def get_trajectory(self, t0_ns: int, t1_ns: int) -> PoseTrajectory:
        """Return ``T_slam_lidar`` between two times; raises ProductNotFoundError without a pose there."""
        return self._products.trajectory(t0_ns, t1_ns)

    def state(self) -> LidarMap | None:
        """Return the map with the position of the lidar; None before the first sweep."""
        return self.export_map() if len(self.keyframes) else None

    def resume(self, state: Any) -> None:
        """Import the map of a previous run; raises InputError if ``state`` is not a LidarMap.

        The relocalisation starts at the last position of that run.
        """
        if not isinstance(state, LidarMap):
            raise InputError(f"{self.name}: state of type {type(state).__name__}, expected LidarMap")
        self.forget()
        keys = self._import(state)
        if state.last_position is not None:
            key, T_keyframe_lidar = state.last_position
            self._relocaliser.resume(keys[key], T_keyframe_lidar)

    def _import(self, message: LidarMap) -> dict[int, int]:
        self.state_revision += 1
        return self._mapper.import_map(message)

    def _update_checkpoint(self, is_keyframe_complete: bool) -> None:
        if self._checkpoints.is_due(self._mapper.path_length_m) or is_keyframe_complete:
            self.state_revision += 1

    def _restart_on_map(self, key: int, scan: LidarScan) -> TrackingResult | None:
        """Register the first sweep after a restart with the stored map, which becomes the local map.

        Return None if the sweep does not match; the tracker then keeps the local map that this sweep started.
        """
        T_map_keyframe = self.keyframes.poses[key]
        tracker = self._new_tracker(self._tracker.predictor)
        tracker.start_on_map(T_map_keyframe, self._mapper.local_points(self.config.max_range_m))
        tracking = tracker.track(scan)
        if tracking.registration is None or tracking.is_lost:
            return None
        T_keyframe_lidar = se3.normalise_transform(se3.inverse(T_map_keyframe) @ tracking.T_odom_lidar)
        self._tracker = tracker
        covariance = rotate_covariance(tracking.registration.covariance, T_map_keyframe[:3, :3].T)
        self._mapper.T_keyframe_lidar = UncertainTransform(T_keyframe_lidar, covariance)
        return tracking

    def _new_tracker(self, predictor: MotionPredictor) -> ScanTracker:
        """Return a tracker with an empty local map."""
        return ScanTracker(self.config, self.dfn("deskewing"), self.dfn("tracking"), predictor)

    def _T_base_lidar(self) -> np.ndarray[Any, np.dtype[np.float64]] | None:
        """Return the mount of the lidar (4, 4); None if unknown: poses predicted from odometry are then
        DEGRADED.
        """
        base, lidar = f"{self.context.robot}/base", self.context.sensor_frame("lidar", "lidar")
        try:
            return self.context.frames.lookup(base, lidar, 0).matrix
        except FrameNotFoundError:
            return None

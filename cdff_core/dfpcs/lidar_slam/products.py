# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Outputs of LidarSlam with their quality."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Output
from cdff_common.interfaces.product import CovarianceKind, Quality
from cdff_common.types import LidarMap, LidarScan, Pointcloud
from cdff_core.dfpcs.lidar_slam.configuration import TrackingGates
from cdff_core.dfpcs.lidar_slam.keyframe_mapper import KeyframeMapper
from cdff_core.dfpcs.lidar_slam.quality import degradation_reasons, registration_metrics
from cdff_core.dfpcs.lidar_slam.relocaliser import Relocaliser
from cdff_core.dfpcs.lidar_slam.scan_tracker import TrackingResult
from cdff_core.keyframe_graph.products import GraphProducts


class ProductBuilder(GraphProducts[KeyframeMapper]):
    """Builds the outputs, in the frames ``{robot}/slam``,
    ``{robot}/lidar_odom`` and the frame of the lidar.
    """

    def __init__(
        self,
        producer: str,
        robot: str,
        lidar_frame: str,
        gates: TrackingGates,
        mapper: KeyframeMapper,
        relocaliser: Relocaliser,
    ) -> None:
        super().__init__(producer, f"{robot}/slam", mapper)
        self._gates, self._relocaliser = gates, relocaliser
        self._odom_frame, self._lidar_frame = f"{robot}/lidar_odom", lidar_frame
        self._odometry_covariance = np.zeros((6, 6))
        self._degraded_sweeps = 0
        self._inputs: tuple[str, ...] = ()

    def poses(self, scan: LidarScan, sample_id: str, tracking: TrackingResult) -> Iterator[Output]:
        """Yield odometry and pose of the lidar at the end of a sweep."""
        self._inputs = (sample_id,)
        reasons = degradation_reasons(tracking, self._gates)
        self._degraded_sweeps += bool(reasons)
        metrics = registration_metrics(tracking) | {
            "keyframes": len(self._mapper.keyframes),
            "path_length_m": self._mapper.path_length_m,
        }
        odometry = self._accumulate(tracking)
        if tracking.is_lost:
            failed = Quality.failed("lost", *reasons, metrics=metrics)
            yield self._pose("odometry", self._odom_frame, None, scan, failed)
            yield self._pose("pose", self._map_frame, None, scan, failed)
            return
        quality = Quality.from_reasons(reasons, CovarianceKind.FORMAL, metrics)
        yield self._pose("odometry", self._odom_frame, tracking.with_pose_covariance(odometry), scan, quality)
        T_map_lidar = self._mapper.T_map_lidar
        if T_map_lidar is None or self._relocaliser.is_uncertain:
            failed = Quality.failed("not_localised_in_map", *reasons, metrics=metrics)
            yield self._pose("pose", self._map_frame, None, scan, failed)
        else:
            yield self._pose(
                "pose", self._map_frame, tracking.with_pose_covariance(T_map_lidar), scan, quality
            )

    @property
    def sensor_frame(self) -> str:
        """Frame of the lidar."""
        return self._lidar_frame

    @property
    def inputs(self) -> tuple[str, ...]:
        """Id of the newest sweep."""
        return self._inputs

    def cloud_output(self) -> Output:
        """Return the whole map as an output."""
        cloud = self.cloud(0.0)
        return Output(
            "cloud",
            cloud,
            self._mapper.keyframes.first_ns,
            cloud.stamp_ns,
            self._map_frame,
            None,
            self.map_quality(),
        )

    def cloud(self, voxel_m: float) -> Pointcloud:
        """Return the whole map as a cloud; raises ProductNotFoundError without a map."""
        self.require_map()
        points_m = self._mapper.cloud(voxel_m)
        return Pointcloud.from_points(points_m, frame=self._map_frame, stamp_ns=self.newest_ns)

    def lidar_map(self) -> LidarMap:
        """Return all keyframes and the position of the lidar; raises ProductNotFoundError without a map."""
        self.require_map()
        mapper, position = self._mapper, self._relocaliser.last_position
        if mapper.current is not None:
            mapper.update_cloud(with_descriptor=False)
            position = position or (mapper.current, mapper.T_keyframe_lidar.matrix)
        return mapper.keyframes.to_message(
            frame=self._map_frame, sensor=self._lidar_frame, producer=self._producer, position=position
        )

    def map_quality(self) -> Quality:
        """Return the quality of the map: degraded sweeps and keyframes that are not linked."""
        keyframes = self._mapper.keyframes
        unlinked = len(keyframes) - len(self._mapper.keyframes.linked)
        reasons = [f"degraded_sweeps:{self._degraded_sweeps}"] if self._degraded_sweeps else []
        reasons += [f"keyframes_not_linked:{unlinked}"] if unlinked else []
        metrics = {
            "keyframes": len(keyframes),
            "loops": keyframes.loop_count,
            "loops_rejected": keyframes.loops_rejected,
            "refused_loops": self._mapper.closer.refusals.total(),
            "cloud_mb": keyframes.point_bytes / 1e6,
            "path_length_m": self._mapper.path_length_m,
        }
        return Quality.from_reasons(reasons, CovarianceKind.FORMAL, metrics)

    def _accumulate(self, tracking: TrackingResult) -> UncertainTransform:
        """Return the odometry with the drift accumulated over all sweeps."""
        T_odom_previous = se3.normalise_transform(
            tracking.T_odom_lidar @ se3.inverse(tracking.increment.matrix)
        )
        odometry = UncertainTransform(T_odom_previous, self._odometry_covariance) @ tracking.increment
        assert odometry.covariance is not None  # both factors have one
        self._odometry_covariance = odometry.covariance
        return odometry

    def _pose(
        self, port: str, parent: str, T: UncertainTransform | None, scan: LidarScan, quality: Quality
    ) -> Output:
        """Return a pose of the lidar as an output; ``T`` is None for FAILED."""
        return Output.of_pose(
            port,
            T,
            t0_ns=scan.t0_ns,
            stamp_ns=scan.t1_ns,
            frame=parent,
            child=self._lidar_frame,
            quality=quality,
            inputs=self._inputs,
            producer=self._producer,
        )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC LidarSlam."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import LidarMap, Pointcloud, PoseTrajectory


class LidarSlamInterface(Dfpc):
    """Estimate the poses of a robot with a lidar, and a map of its environment: sweeps are registered
    with a local map, keyframes store the points, and loop closures in a pose graph correct drift.
    Neither gravity nor an IMU is needed.
    """

    name = "lidar_slam"
    INPUT_PORTS = ("scan", "odometry", "map")

    @abstractmethod
    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type LidarScan. Sweep of the lidar, each point with its own time; each
        sweep yields one pose.
        """

    @abstractmethod
    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_odom_base of the wheels or the position
        manager; predicts the motion and constrains degenerate directions.
        """

    @abstractmethod
    def on_map(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type LidarMap. A map of an earlier run or of another robot; used as the
        map if there is none yet, otherwise connected with the present map by a loop closure.
        """

    @abstractmethod
    def export_map(self) -> LidarMap:
        """Keyframes with their clouds, the graph and the pose of the lidar: the input of port map."""

    @abstractmethod
    def get_map(self, voxel_m: float) -> Pointcloud:
        """The whole map as a cloud."""

    @abstractmethod
    def get_trajectory(self, t0_ns: int, t1_ns: int) -> PoseTrajectory:
        """Corrected T_slam_lidar between two times."""

    @abstractmethod
    def forget(self) -> None:
        """Clear map and trajectory and start again."""

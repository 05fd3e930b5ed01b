# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC LidarSlam."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import LidarMap, Pointcloud, PoseTrajectory


class LidarSlamInterface(Dfpc):
    """Where a robot with a lidar is, and a map of where it was: sweeps are registered on a map of the surroundings,
    key frames keep what was seen, places that are seen again close loops in a pose graph. Needs neither gravity
    nor an IMU.
    """

    name = "lidar_slam"
    INPUT_PORTS = ("scan", "odometry", "map")

    def step(self, sample: Sample) -> Iterable[Output]:
        """Hand the sample to the handler of its port; raises InputError on a port that is not there."""
        match sample.port:
            case "scan":
                return self.on_scan(sample)
            case "odometry":
                return self.on_odometry(sample)
            case "map":
                return self.on_map(sample)
            case _:
                raise InputError(f"{self.name}: no input port {sample.port!r}; it has {', '.join(self.INPUT_PORTS)}")

    @abstractmethod
    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Take a LidarScan: Sweep of the lidar, each point at its own time; each leads to one pose."""

    @abstractmethod
    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: T_odom_base by wheels or position manager: what the motion is guessed by,
        and what holds on ground that says nothing.
        """

    @abstractmethod
    def on_map(self, sample: Sample) -> Iterable[Output]:
        """Take a LidarMap: A map made before or by another robot: taken over where there is none yet, else merged as
        soon as both show the same place.
        """

    @abstractmethod
    def export_map(self) -> LidarMap:
        """Key frames with their clouds and graph, and where the lidar is: what port map takes."""

    @abstractmethod
    def get_map(self, voxel_m: float) -> Pointcloud:
        """The whole map as a cloud."""

    @abstractmethod
    def get_trajectory(self, t0_ns: int, t1_ns: int) -> PoseTrajectory:
        """T_slam_lidar between two times, as known now."""

    @abstractmethod
    def forget(self) -> None:
        """Forget map and trajectory and begin anew."""

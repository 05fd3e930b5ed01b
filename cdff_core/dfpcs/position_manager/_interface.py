# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC PositionManager."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import PoseTrajectory, TransformWithCovariance


class PositionManagerInterface(Dfpc):
    """Where the robot is: its frame tree and its time line. An error-state filter joins wheels, IMU, visual and
    lidar odometry and absolute fixes, in whatever order they arrive; any frame can be asked for in any other, at
    any two times.
    """

    name = "position_manager"
    INPUT_PORTS = ("odometry", "visual_odometry", "lidar_odometry", "imu", "fix", "absolute_fix", "joints")

    def step(self, sample: Sample) -> Iterable[Output]:
        """Hand the sample to the handler of its port; raises InputError on a port that is not there."""
        match sample.port:
            case "odometry":
                return self.on_odometry(sample)
            case "visual_odometry":
                return self.on_visual_odometry(sample)
            case "lidar_odometry":
                return self.on_lidar_odometry(sample)
            case "imu":
                return self.on_imu(sample)
            case "fix":
                return self.on_fix(sample)
            case "absolute_fix":
                return self.on_absolute_fix(sample)
            case "joints":
                return self.on_joints(sample)
            case _:
                raise InputError(f"{self.name}: no input port {sample.port!r}; it has {', '.join(self.INPUT_PORTS)}")

    @abstractmethod
    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: T_odom_base of the wheels, counted from their origin."""

    @abstractmethod
    def on_visual_odometry(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: T_vo_camera, counted from the first image."""

    @abstractmethod
    def on_lidar_odometry(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: T_lidarodom_lidar, counted from the first sweep."""

    @abstractmethod
    def on_imu(self, sample: Sample) -> Iterable[Output]:
        """Take a IMUSensors: Specific force and angular rate in the frame {robot}/imu."""

    @abstractmethod
    def on_fix(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: Absolute pose of the base or a sensor: in a fixed frame of the tree, or in
        a frame that is placed by its first pose, as lidar_slam's.
        """

    @abstractmethod
    def on_absolute_fix(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: The same from a second source, as absolute_localisation's pose on an
        orbital model; rare, so nothing is silent because of it.
        """

    @abstractmethod
    def on_joints(self, sample: Sample) -> Iterable[Output]:
        """Take a Joints: Values of the joints of the robot's URDF."""

    @abstractmethod
    def get_pose(self, parent: str, child: str, t_ns: int) -> TransformWithCovariance:
        """T_parent_child at a time, interpolated; refused outside the known span by more than the limit."""

    @abstractmethod
    def get_transform(self, parent: str, parent_t_ns: int, child: str, child_t_ns: int) -> TransformWithCovariance:
        """T_parent_child of the parent at one time and the child at another, with the covariance of the motion in
        between alone.
        """

    @abstractmethod
    def get_trajectory(self, t0_ns: int, t1_ns: int) -> PoseTrajectory:
        """T_site_base between two times."""

    @abstractmethod
    def pin(self, t_ns: int) -> TransformWithCovariance:
        """Keep a time, however old it gets, and return T_site_base then."""

    @abstractmethod
    def unpin(self, t_ns: int) -> None:
        """Let a pinned time be forgotten like others."""

    @abstractmethod
    def get_pins(self) -> PoseTrajectory:
        """T_site_base at all pinned times."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC PositionManager."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import PoseTrajectory, TransformWithCovariance


class PositionManagerInterface(Dfpc):
    """Estimate the pose of the robot, and maintain its frame tree and trajectory. An error-state
    filter fuses wheels, IMU, visual and lidar odometry and absolute poses in any order of arrival.
    On request it returns the transform between any two frames at any two times.
    """

    name = "position_manager"
    INPUT_PORTS = ("odometry", "visual_odometry", "lidar_odometry", "imu", "fix", "absolute_fix", "joints")

    @abstractmethod
    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_odom_base of wheel odometry."""

    @abstractmethod
    def on_visual_odometry(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_vo_camera, relative to the first image."""

    @abstractmethod
    def on_lidar_odometry(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_lidarodom_lidar, relative to the first
        sweep.
        """

    @abstractmethod
    def on_imu(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type IMUSensors. Specific force and angular rate in the frame
        {robot}/imu.
        """

    @abstractmethod
    def on_fix(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. Absolute pose of the base or a sensor in a
        fixed frame of the tree, or in another fixed frame, which the first fix locates (for example
        the frame of lidar_slam).
        """

    @abstractmethod
    def on_absolute_fix(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. Absolute pose from a second source, for
        example the pose of absolute_localisation on an orbital model; because it is rare, poses are
        published between its samples too.
        """

    @abstractmethod
    def on_joints(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Joints. Values of the joints of the robot's URDF."""

    @abstractmethod
    def get_pose(self, parent: str, child: str, t_ns: int) -> TransformWithCovariance:
        """T_parent_child at a time, interpolated; refused if the time is outside the trajectory by
        more than the limit.
        """

    @abstractmethod
    def get_transform(
        self, parent: str, parent_t_ns: int, child: str, child_t_ns: int
    ) -> TransformWithCovariance:
        """T_parent_child between the parent at one time and the child at another time, with the
        covariance of the motion in between.
        """

    @abstractmethod
    def get_trajectory(self, t0_ns: int, t1_ns: int) -> PoseTrajectory:
        """T_site_base between two times."""

    @abstractmethod
    def pin(self, t_ns: int) -> TransformWithCovariance:
        """Keep the pose at a time permanently and return this T_site_base."""

    @abstractmethod
    def unpin(self, t_ns: int) -> None:
        """Release a pinned time."""

    @abstractmethod
    def get_pins(self) -> PoseTrajectory:
        """T_site_base at all pinned times."""

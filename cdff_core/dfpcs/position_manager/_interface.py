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
    """Where the robot is: its frame tree and its time line. Motion comes from visual odometry where that stands for
    it, else from the wheels, turned by the gyro; both are taken as increments, so that handing over makes no
    jump.
    """

    name = "position_manager"
    INPUT_PORTS = ("odometry", "visual_odometry", "imu")

    def step(self, sample: Sample) -> Iterable[Output]:
        """Hand the sample to the handler of its port; raises InputError on a port that is not there."""
        match sample.port:
            case "odometry":
                return self.on_odometry(sample)
            case "visual_odometry":
                return self.on_visual_odometry(sample)
            case "imu":
                return self.on_imu(sample)
            case _:
                raise InputError(f"{self.name}: no input port {sample.port!r}; it has {', '.join(self.INPUT_PORTS)}")

    @abstractmethod
    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: T_odom_base of the wheels, counted from their origin."""

    @abstractmethod
    def on_visual_odometry(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: T_vo_camera, counted from the first image."""

    @abstractmethod
    def on_imu(self, sample: Sample) -> Iterable[Output]:
        """Take a IMUSensors: Specific force and angular rate in the frame {robot}/imu."""

    @abstractmethod
    def get_pose(self, parent: str, child: str, t_ns: int) -> TransformWithCovariance:
        """T_parent_child at a time, interpolated; refused outside the known span by more than the limit."""

    @abstractmethod
    def get_trajectory(self, t0_ns: int, t1_ns: int) -> PoseTrajectory:
        """T_site_base between two times."""

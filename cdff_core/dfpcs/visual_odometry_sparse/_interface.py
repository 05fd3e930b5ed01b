# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC VisualOdometrySparse."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import PoseTrajectory


class VisualOdometrySparseInterface(Dfpc):
    """Motion of a rectified stereo camera from points tracked between its images."""

    name = "visual_odometry_sparse"
    INPUT_PORTS = ("stereo", "odometry", "imu")

    def step(self, sample: Sample) -> Iterable[Output]:
        """Hand the sample to the handler of its port; raises InputError on a port that is not there."""
        match sample.port:
            case "stereo":
                return self.on_stereo(sample)
            case "odometry":
                return self.on_odometry(sample)
            case "imu":
                return self.on_imu(sample)
            case _:
                raise InputError(f"{self.name}: no input port {sample.port!r}; it has {', '.join(self.INPUT_PORTS)}")

    @abstractmethod
    def on_stereo(self, sample: Sample) -> Iterable[Output]:
        """Take a FramePair: Rectified grey or colour pair with camera matrix and baseline, in order of capture."""

    @abstractmethod
    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: T_odom_base of the wheels: tells where to look and bridges what is not
        seen; never part of the estimate.
        """

    @abstractmethod
    def on_imu(self, sample: Sample) -> Iterable[Output]:
        """Take a IMUSensors: Angular rates, likewise for the rotation."""

    @abstractmethod
    def get_trajectory(self) -> PoseTrajectory:
        """All poses since the start or reset, with covariance."""

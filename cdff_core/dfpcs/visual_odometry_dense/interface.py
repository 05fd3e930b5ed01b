# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC VisualOdometryDense."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import PoseTrajectory


class VisualOdometryDenseInterface(Dfpc):
    """Estimate the motion of a rectified stereo camera from the grey levels and disparities of all
    textured pixels.
    """

    name = "visual_odometry_dense"
    INPUT_PORTS = ("stereo", "odometry", "imu", "attitude")

    @abstractmethod
    def on_stereo(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type FramePair. Rectified grey or colour pair with camera matrix and
        baseline, in order of capture.
        """

    @abstractmethod
    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_odom_base of the wheels: predicts the
        motion and bridges gaps; not fused into the estimate.
        """

    @abstractmethod
    def on_imu(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type IMUSensors. Angular rates: predict the rotation; not fused into the
        estimate.
        """

    @abstractmethod
    def on_attitude(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. Attitude fix T_site_base, for example by
        the Sun: only the rotation and its covariance are used, a large variance for an axis that is
        not measured; fused into the pose.
        """

    @abstractmethod
    def get_trajectory(self) -> PoseTrajectory:
        """All poses since the start or reset, with covariance."""

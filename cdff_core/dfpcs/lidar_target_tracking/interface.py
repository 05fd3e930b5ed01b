# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC LidarTargetTracking."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class LidarTargetTrackingInterface(Dfpc):
    """Track a known body in lidar scans: each scan is registered with the mesh of the body, starting
    at the predicted state. The result corrects position, velocity, attitude, angular rate and
    centre of mass.
    """

    name = "lidar_target_tracking"
    INPUT_PORTS = ("model", "scan", "cloud", "guess", "detections", "attitude")

    @abstractmethod
    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Mesh. Mesh of the body, whose frame is {name}/body; a different
        mesh starts a new track.
        """

    @abstractmethod
    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type LidarScan. Scan whose points have times, so that the motion of the
        body during the scan is compensated.
        """

    @abstractmethod
    def on_cloud(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Pointcloud. Scan whose points have one time."""

    @abstractmethod
    def on_guess(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_sensor_body at the first scan after the
        guess; without a guess the body is detected.
        """

    @abstractmethod
    def on_detections(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type ObjectDetections. Detections of the body in the frame of the scans;
        they replace the own search if search_scans is false.
        """

    @abstractmethod
    def on_attitude(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. Rotation of T_inertial_sensor, or of
        T_inertial_frame of a frame with a known mount, such as a star tracker; velocities are then
        relative to the inertial axes.
        """

    @abstractmethod
    def restart(self) -> None:
        """Clear the track; the body is detected in the next scan."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC Reconstruction3D."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import Mesh


class Reconstruction3DInterface(Dfpc):
    """Reconstruct the surface of an unknown body or scene from depth images, lidar scans or stereo
    pairs: a mesh and a cloud with colour and standard deviation. The poses are given or, for one
    body, determined by registration with the surface.
    """

    name = "reconstruction_3d"
    INPUT_PORTS = ("depth", "cloud", "scan", "stereo", "image", "poses")

    @abstractmethod
    def on_depth(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type DistanceImage. Distances along the optical axis; 0 without a
        measurement.
        """

    @abstractmethod
    def on_cloud(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Pointcloud. Lidar cloud in the frame of the sensor, captured at one
        time.
        """

    @abstractmethod
    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type LidarScan. Lidar scan in the frame of the sensor; its points are
        taken as captured at its stamp.
        """

    @abstractmethod
    def on_stereo(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type FramePair. Rectified stereo pair."""

    @abstractmethod
    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Frame. Image of the same time as a depth image, for the colour."""

    @abstractmethod
    def on_poses(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_model_sensor; or T_sensor_body of a
        tracker if its parent is the frame of the sensor, or with pose_of: body; ignored with
        solve_poses.
        """

    @abstractmethod
    def get_mesh(self) -> Mesh:
        """The surface of all captures so far."""

    @abstractmethod
    def restart(self) -> None:
        """Clear the surface; the next capture starts a new one."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC TargetDetection."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class TargetDetectionInterface(Dfpc):
    """Determine the pose of a known body in one lidar scan or one image from its mesh, without a
    guess. Scans of other bodies, and scans and images that do not determine a pose, are refused.
    """

    name = "target_detection"
    INPUT_PORTS = ("model", "cloud", "scan", "position", "image")

    @abstractmethod
    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Mesh. Mesh of a body, whose frame is {name}/body; stored until a
        new mesh of this name arrives.
        """

    @abstractmethod
    def on_cloud(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Pointcloud. Scan with the sensor at its origin; each scan yields
        one list of detections.
        """

    @abstractmethod
    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type LidarScan. Scan with a time for each point; the motion during the
        scan is ignored.
        """

    @abstractmethod
    def on_position(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. Expected position of the bodies,
        T_sensor_body in the frame of any sensor with a known mount; bodies far from it are not
        examined.
        """

    @abstractmethod
    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Frame. 8-bit image with its camera; the background of the body must
        be dark; yields up to four poses, DEGRADED.
        """

    @abstractmethod
    def clear_models(self) -> None:
        """Remove all models."""

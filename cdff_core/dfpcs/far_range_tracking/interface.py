# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC FarRangeTracking."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import ObjectTrack


class FarRangeTrackingInterface(Dfpc):
    """Detect and track distant rovers and landmarks on the ground: direction with covariance from
    motion and appearance, and range from apparent size, stereo or the terrain.
    """

    name = "far_range_tracking"
    INPUT_PORTS = ("image", "pair", "attitude", "pose", "dem", "model", "designation")

    @abstractmethod
    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Frame. Grey or colour image with its camera, 8 bit."""

    @abstractmethod
    def on_pair(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type FramePair. Rectified pair with camera matrix and baseline, 8 bit;
        replaces the image and also measures the range.
        """

    @abstractmethod
    def on_attitude(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. Rotation of T_inertial_camera, or of
        another frame with a known mount.
        """

    @abstractmethod
    def on_pose(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_site_base or T_odom_base of the
        observer, or the pose of its camera; must arrive before the image of the same time.
        """

    @abstractmethod
    def on_dem(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type ElevationMap. Elevation map in the frame of the track; the range is
        measured to the terrain below the object.
        """

    @abstractmethod
    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Mesh. Mesh of the object with z up; its height makes the range
        observable.
        """

    @abstractmethod
    def on_designation(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type ObjectDetections. Image boxes of objects to track, such as
        landmarks at rest, at the time of an image.
        """

    @abstractmethod
    def predict(self, id: int, t_ns: int) -> ObjectTrack:
        """Direction and covariance of an object at a time, predicted from its motion."""

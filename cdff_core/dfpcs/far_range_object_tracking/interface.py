# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC FarRangeObjectTracking."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import ObjectTrack


class FarRangeObjectTrackingInterface(Dfpc):
    """Detect and track unresolved and small objects among the stars: direction in the inertial frame
    with covariance from the first images, and range from the apparent size once the object is
    resolved and if its size is known.
    """

    name = "far_range_object_tracking"
    INPUT_PORTS = ("image", "attitude", "navigation", "model", "body_attitude", "sun")

    @abstractmethod
    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Frame. Grey or colour image with its camera, 8 or 16 bit or float;
        grey levels proportional to the light.
        """

    @abstractmethod
    def on_attitude(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. Rotation of T_inertial_camera, or of
        T_inertial_frame of a frame with a known mount, such as a star tracker.
        """

    @abstractmethod
    def on_navigation(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type RigidBodyState. Position and velocity of the camera's carrier
        relative to the Earth, in the frame inertial; the velocity corrects the aberration of the
        stars, both are needed for track_lvlh.
        """

    @abstractmethod
    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Mesh. Mesh of the target, whose frame is {name}/body; its size
        makes the range observable.
        """

    @abstractmethod
    def on_body_attitude(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_inertial_body, rotation only; without it
        the range is an interval.
        """

    @abstractmethod
    def on_sun(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Vector3d. Direction from the target to the Sun in the frame
        inertial; default: the direction from the Earth.
        """

    @abstractmethod
    def predict(self, id: int, t_ns: int) -> ObjectTrack:
        """Direction and covariance of an object at a time, predicted from its motion."""

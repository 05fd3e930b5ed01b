# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC Tracking3D."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import BodyMotion, ObjectTrack, TransformWithCovariance


class Tracking3DInterface(Dfpc):
    """Estimate the motion of a body from measured poses (rotation axis, period, centre of mass, ratios
    of the moments of inertia), and predict its poses, for example to capture it.
    """

    name = "tracking_3d"
    INPUT_PORTS = ("pose", "attitude", "navigation")

    @abstractmethod
    def on_pose(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_reference_body in a reference frame that
        does not rotate, or in that of a sensor whose attitude is given, from any detector or
        tracker; poses without covariance count as equally accurate.
        """

    @abstractmethod
    def on_attitude(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. Rotation of T_inertial_sensor, or of
        T_inertial_frame of a frame with a known mount, such as a star tracker; poses in the frame
        of a sensor are rotated to the inertial axes.
        """

    @abstractmethod
    def on_navigation(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type RigidBodyState. Position and velocity of the carrier of the sensor
        relative to the Earth, in the frame inertial; then the body moves in a nearly straight line
        relative to a point at rest in the LVLH axes, not relative to the carrier.
        """

    @abstractmethod
    def predict(self, t_ns: int) -> TransformWithCovariance:
        """T_reference_body at a time that is not before the newest pose."""

    @abstractmethod
    def predict_point(self, x_m: float, y_m: float, z_m: float, t_ns: int) -> ObjectTrack:
        """Motion of a point that is fixed in the body, such as a grasp point, from the newest pose to
        a time: one state per step, with the orientation of the body.
        """

    @abstractmethod
    def get_motion(self) -> BodyMotion:
        """The last estimate of the motion."""

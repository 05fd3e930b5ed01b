# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC VisualTargetTracking."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class VisualTargetTrackingInterface(Dfpc):
    """Track a known body in the images of a camera, starting from a guess. The edges of each image,
    and the depths if there is a depth image, are compared with the mesh at the predicted state. The
    differences correct position, velocity, attitude, angular rate and centre of mass.
    """

    name = "visual_target_tracking"
    INPUT_PORTS = ("model", "image", "depth", "guess", "sun")

    @abstractmethod
    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Mesh. Mesh of the body, whose frame is {name}/body; a different
        mesh ends the track.
        """

    @abstractmethod
    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Frame. 8-bit grey or colour image with its camera, without lens
        distortion.
        """

    @abstractmethod
    def on_depth(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type DistanceImage. Depths along the optical axis, 0 without a
        measurement; at the time of an image, or without an image.
        """

    @abstractmethod
    def on_guess(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_camera_body at the first image after the
        guess; starts a new track.
        """

    @abstractmethod
    def on_sun(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Vector3d. Direction to the Sun in the frame of the camera, for the
        images after it; with it the shading and the shadows of the body are used.
        """

    @abstractmethod
    def restart(self) -> None:
        """Clear the track; the next guess starts a new one."""

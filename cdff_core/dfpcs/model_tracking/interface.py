# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC ModelTracking."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class ModelTrackingInterface(Dfpc):
    """Track a known object (a tool, a rock, a component of a rover) in the images and depth images of
    a camera. Texture, depths and edges correct its state; without a guess, and after a loss, the
    object is detected in a depth image.
    """

    name = "model_tracking"
    INPUT_PORTS = ("model", "depth", "image", "guess")

    @abstractmethod
    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Mesh. Mesh of the object, whose frame is {name}/body; a different
        mesh ends the track.
        """

    @abstractmethod
    def on_depth(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type DistanceImage. Depths along the optical axis, 0 without a
        measurement; at the time of an image, or without an image.
        """

    @abstractmethod
    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Frame. 8-bit grey or colour image with its camera, without lens
        distortion.
        """

    @abstractmethod
    def on_guess(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_camera_body at the first image after the
        guess; starts a new track; without a guess the object is detected.
        """

    @abstractmethod
    def restart(self) -> None:
        """Clear the track; the object is detected again."""

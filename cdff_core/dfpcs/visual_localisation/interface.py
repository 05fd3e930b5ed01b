# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC VisualLocalisation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class VisualLocalisationInterface(Dfpc):
    """Estimate the pose of a camera in an existing map of keyframes from one image, without a guess.
    Similar keyframes are searched for, their points are matched with the image, and the pose is
    estimated with covariance; images of other places are refused.
    """

    name = "visual_localisation"
    INPUT_PORTS = ("map", "image", "pair")

    @abstractmethod
    def on_map(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type VisualMap. Map of cdff map build; replaces the previous map."""

    @abstractmethod
    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Frame. Image with its camera, lens distortion included; yields one
        pose.
        """

    @abstractmethod
    def on_pair(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type FramePair. Stereo pair: the left image is located, the right one
        shows whether the cameras are swapped; yields one pose.
        """

    @abstractmethod
    def forget_map(self) -> None:
        """Clear the map."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC FeatureMatching."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class FeatureMatchingInterface(Dfpc):
    """Match points between two images of one scene, state the probability that each match is correct,
    and estimate the epipolar geometry and the homography with their covariances. Images without a
    common scene yield FAILED.
    """

    name = "feature_matching"
    INPUT_PORTS = ("left", "right")

    @abstractmethod
    def on_left(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Frame. First image, stored until the second one arrives; without
        lens distortion.
        """

    @abstractmethod
    def on_right(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Frame. Second image; each one yields one output."""

    @abstractmethod
    def forget(self) -> None:
        """Clear the stored images."""

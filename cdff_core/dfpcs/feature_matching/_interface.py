# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC FeatureMatching."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class FeatureMatchingInterface(Dfpc):
    """Find what two images of one scene have in common: points and their partners with the probability that each
    pair is right, the epipolar geometry and the homography with their uncertainty; say so where they have nothing
    in common.
    """

    name = "feature_matching"
    INPUT_PORTS = ("left", "right")

    def step(self, sample: Sample) -> Iterable[Output]:
        """Hand the sample to the handler of its port; raises InputError on a port that is not there."""
        match sample.port:
            case "left":
                return self.on_left(sample)
            case "right":
                return self.on_right(sample)
            case _:
                raise InputError(f"{self.name}: no input port {sample.port!r}; it has {', '.join(self.INPUT_PORTS)}")

    @abstractmethod
    def on_left(self, sample: Sample) -> Iterable[Output]:
        """Take a Frame: First image, kept until its partner comes; without lens distortion."""

    @abstractmethod
    def on_right(self, sample: Sample) -> Iterable[Output]:
        """Take a Frame: Second image; each leads to one answer."""

    @abstractmethod
    def forget(self) -> None:
        """Forget the image that waits."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC BundleAdjustment."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import BundleProblem


class BundleAdjustmentInterface(Dfpc):
    """Adjust cameras, points and on request lenses to where the points were seen, in single images or rectified
    pairs: least squares or robust, with the gauge stated, covariances of poses and points, and cameras
    marginalised to a prior.
    """

    name = "bundle_adjustment"
    INPUT_PORTS = ("problem",)

    def step(self, sample: Sample) -> Iterable[Output]:
        """Hand the sample to the handler of its port; raises InputError on a port that is not there."""
        match sample.port:
            case "problem":
                return self.on_problem(sample)
            case _:
                raise InputError(f"{self.name}: no input port {sample.port!r}; it has {', '.join(self.INPUT_PORTS)}")

    @abstractmethod
    def on_problem(self, sample: Sample) -> Iterable[Output]:
        """Take a BundleProblem: Cameras, lenses, points, observations and what is known beforehand; each leads to
        one answer.
        """

    @abstractmethod
    def marginalise(self, cameras: str) -> BundleProblem:
        """Drop cameras and the points they saw from the last problem; what they say of the rest becomes its prior."""

    @abstractmethod
    def forget(self) -> None:
        """Forget the last problem."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC BundleAdjustment."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import BundleProblem


class BundleAdjustmentInterface(Dfpc):
    """Adjust cameras, points and, on request, lenses to the observations in single images or rectified
    pairs, by least squares or with a robust loss. The result states the gauge and the covariances
    of poses and points. Cameras can be marginalised to a prior.
    """

    name = "bundle_adjustment"
    INPUT_PORTS = ("problem",)

    @abstractmethod
    def on_problem(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type BundleProblem. Cameras, lenses, points, observations and prior."""

    @abstractmethod
    def marginalise(self, cameras: str) -> BundleProblem:
        """Remove cameras and their points from the last problem; their information on the remaining
        cameras becomes a prior.
        """

    @abstractmethod
    def forget(self) -> None:
        """Clear the last problem."""

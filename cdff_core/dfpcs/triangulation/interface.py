# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC Triangulation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class TriangulationInterface(Dfpc):
    """Compute 3-D points from images: either sparse points with covariance from their observations in
    two or more images with known poses, or a dense cloud with grey values and depth standard
    deviations from a rectified stereo pair.
    """

    name = "triangulation"
    INPUT_PORTS = ("tracks", "matches", "pose", "stereo")

    @abstractmethod
    def on_tracks(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type BundleProblem. Cameras with known poses and their observations of
        points.
        """

    @abstractmethod
    def on_matches(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type CorrespondenceMap2D. Pairs of points in two images of the
        configured camera, pixels without distortion; processed when a pose arrives.
        """

    @abstractmethod
    def on_pose(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_left_right of the two images; the parent
        is the first camera, the child the second.
        """

    @abstractmethod
    def on_stereo(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type FramePair. Rectified stereo pair with camera matrix and baseline."""

    @abstractmethod
    def forget(self) -> None:
        """Clear matches and pose."""

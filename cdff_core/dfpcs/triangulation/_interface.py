# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC Triangulation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class TriangulationInterface(Dfpc):
    """Build points in space from images: sparse ones from where they appear in two or more images taken at known
    poses, each with its covariance, or a dense cloud with grey values from a rectified stereo pair, each point
    with the uncertainty of its depth.
    """

    name = "triangulation"
    INPUT_PORTS = ("tracks", "matches", "pose", "stereo")

    def step(self, sample: Sample) -> Iterable[Output]:
        """Hand the sample to the handler of its port; raises InputError on a port that is not there."""
        match sample.port:
            case "tracks":
                return self.on_tracks(sample)
            case "matches":
                return self.on_matches(sample)
            case "pose":
                return self.on_pose(sample)
            case "stereo":
                return self.on_stereo(sample)
            case _:
                raise InputError(f"{self.name}: no input port {sample.port!r}; it has {', '.join(self.INPUT_PORTS)}")

    @abstractmethod
    def on_tracks(self, sample: Sample) -> Iterable[Output]:
        """Take a BundleProblem: Cameras with known poses and what each saw of which point."""

    @abstractmethod
    def on_matches(self, sample: Sample) -> Iterable[Output]:
        """Take a CorrespondenceMap2D: Pairs of points in two images of the configured camera, pixels without
        distortion; waits for a pose.
        """

    @abstractmethod
    def on_pose(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: T_left_right of the two images: parent the first camera, child the second."""

    @abstractmethod
    def on_stereo(self, sample: Sample) -> Iterable[Output]:
        """Take a FramePair: Rectified stereo pair with camera matrix and baseline."""

    @abstractmethod
    def forget(self) -> None:
        """Forget matches and pose."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC VisualSlam."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import PoseTrajectory, VisualMap


class VisualSlamInterface(Dfpc):
    """Estimate the poses of a stereo or RGB-D camera, and a map of its environment: images are matched
    with keyframes, the keyframes are adjusted together, and loop closures in a pose graph correct
    drift.
    """

    name = "visual_slam"
    INPUT_PORTS = ("pair", "image", "depth", "joints", "map")

    @abstractmethod
    def on_pair(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type FramePair. Rectified stereo pair; each pair yields one pose of the
        left camera.
        """

    @abstractmethod
    def on_image(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Frame. Image of an RGB-D camera; with the depth image of the same
        time it yields one pose.
        """

    @abstractmethod
    def on_depth(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type DistanceImage. Depth image of an RGB-D camera; it need not be
        registered with the image.
        """

    @abstractmethod
    def on_joints(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Joints. Joint positions of the robot, with which the links of its
        URDF are projected into the left image of a pair and masked.
        """

    @abstractmethod
    def on_map(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type VisualMap. A map of an earlier run or of cdff map build; used as
        the map if there is none yet, otherwise connected with the present map by a loop closure.
        """

    @abstractmethod
    def export_map(self) -> VisualMap:
        """Keyframes with their points and the graph: the input of port map."""

    @abstractmethod
    def get_trajectory(self, t0_ns: int, t1_ns: int) -> PoseTrajectory:
        """Corrected T_slam_camera between two times."""

    @abstractmethod
    def forget(self) -> None:
        """Clear map and trajectory and start again."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC DigitalElevationMapping."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import ElevationMap


class DigitalElevationMappingInterface(Dfpc):
    """Elevation patches of the ground in the site's cells, from lidar sweeps, clouds or stereo pairs and the robot's
    poses with covariance.
    """

    name = "digital_elevation_mapping"
    INPUT_PORTS = ("cloud", "scan", "stereo", "poses")

    def step(self, sample: Sample) -> Iterable[Output]:
        """Hand the sample to the handler of its port; raises InputError on a port that is not there."""
        match sample.port:
            case "cloud":
                return self.on_cloud(sample)
            case "scan":
                return self.on_scan(sample)
            case "stereo":
                return self.on_stereo(sample)
            case "poses":
                return self.on_poses(sample)
            case _:
                raise InputError(f"{self.name}: no input port {sample.port!r}; it has {', '.join(self.INPUT_PORTS)}")

    @abstractmethod
    def on_cloud(self, sample: Sample) -> Iterable[Output]:
        """Take a Pointcloud: Cloud taken at one time; without any pose it is taken as already in the frame of the
        map.
        """

    @abstractmethod
    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Take a LidarScan: Lidar sweep with a time for each point."""

    @abstractmethod
    def on_stereo(self, sample: Sample) -> Iterable[Output]:
        """Take a FramePair: Rectified stereo pair."""

    @abstractmethod
    def on_poses(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: T_site_base; its parent is the frame of the map."""

    @abstractmethod
    def get_map(self, resolution_m: float) -> ElevationMap:
        """Local map around the robot, in cells of the given size where that is an integer multiple of the map's."""

    @abstractmethod
    def get_whole_map(self) -> ElevationMap:
        """All that the map holds, in the map's cells, or in ones 2^n times as large where those were more than
        fusion's max_cells (the answer's resolution tells); with implementation LidarGlobal all that was seen.
        """

    @abstractmethod
    def publish_patch(self) -> None:
        """End the patch with the next sample instead of waiting for its period."""

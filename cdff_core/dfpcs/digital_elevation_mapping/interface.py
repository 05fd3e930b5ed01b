# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC DigitalElevationMapping."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import ElevationMap


class DigitalElevationMappingInterface(Dfpc):
    """Compute elevation patches of the terrain in the grid of the site, from lidar sweeps, clouds or
    stereo pairs and the robot's poses with covariance.
    """

    name = "digital_elevation_mapping"
    INPUT_PORTS = ("cloud", "scan", "stereo", "poses")

    @abstractmethod
    def on_cloud(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Pointcloud. Cloud captured at one time; without any pose it is
        assumed to be in the frame of the map.
        """

    @abstractmethod
    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type LidarScan. Lidar sweep with a time for each point."""

    @abstractmethod
    def on_stereo(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type FramePair. Rectified stereo pair."""

    @abstractmethod
    def on_poses(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_site_base; its parent is the frame of
        the map.
        """

    @abstractmethod
    def get_map(self, resolution_m: float) -> ElevationMap:
        """Local map around the robot; its cell size is the largest multiple of the stored cell size
        that does not exceed the requested size.
        """

    @abstractmethod
    def get_whole_map(self) -> ElevationMap:
        """The whole fused map; with LidarGlobal it covers the whole traverse. If the map exceeds
        max_cells cells, it is returned with cells of 2^n times the size.
        """

    @abstractmethod
    def publish_patch(self) -> None:
        """End the patch at the next sample instead of waiting for its period."""

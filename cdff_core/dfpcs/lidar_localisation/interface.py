# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC LidarLocalisation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import Pointcloud


class LidarLocalisationInterface(Dfpc):
    """Estimate the pose of the robot in an existing map: each lidar sweep is registered with the local
    map around the predicted pose; after a failure the whole map is searched; an uncertain result is
    refused.
    """

    name = "lidar_localisation"
    INPUT_PORTS = ("scan", "map", "dem", "graph_map", "odometry", "guess")

    @abstractmethod
    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type LidarScan. Lidar sweep with a time for each point; each sweep
        yields one pose.
        """

    @abstractmethod
    def on_map(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Pointcloud. Cloud of the map, in the map frame; clouds accumulate,
        and a cloud in another frame starts a new map.
        """

    @abstractmethod
    def on_dem(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type ElevationMap. Patch of the map as an elevation map; the mean
        heights of its cells are used.
        """

    @abstractmethod
    def on_graph_map(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type LidarMap. A map exported by lidar_slam: keyframes, their clouds and
        the pose graph; replaces the previous map.
        """

    @abstractmethod
    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. Dead reckoning T_odom_base between sweeps
        and during them.
        """

    @abstractmethod
    def on_guess(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. Initial T_map_base with covariance, used
        as the prediction for the next sweep.
        """

    @abstractmethod
    def get_local_map(self) -> Pointcloud:
        """The local map that sweeps are registered with."""

    @abstractmethod
    def relocalise(self) -> None:
        """Clear the estimate: the pose of the next sweep is searched for in the whole map."""

    @abstractmethod
    def forget_map(self) -> None:
        """Clear map and estimate."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC LidarLocalisation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import Pointcloud


class LidarLocalisationInterface(Dfpc):
    """Where the robot is on a map that was made before: each lidar sweep is matched with the part of the map around
    the predicted pose; lost, the whole map is searched; what cannot be stood for is refused.
    """

    name = "lidar_localisation"
    INPUT_PORTS = ("scan", "map", "dem", "graph_map", "odometry", "guess")

    def step(self, sample: Sample) -> Iterable[Output]:
        """Hand the sample to the handler of its port; raises InputError on a port that is not there."""
        match sample.port:
            case "scan":
                return self.on_scan(sample)
            case "map":
                return self.on_map(sample)
            case "dem":
                return self.on_dem(sample)
            case "graph_map":
                return self.on_graph_map(sample)
            case "odometry":
                return self.on_odometry(sample)
            case "guess":
                return self.on_guess(sample)
            case _:
                raise InputError(f"{self.name}: no input port {sample.port!r}; it has {', '.join(self.INPUT_PORTS)}")

    @abstractmethod
    def on_scan(self, sample: Sample) -> Iterable[Output]:
        """Take a LidarScan: Lidar sweep with a time for each point; each leads to one pose."""

    @abstractmethod
    def on_map(self, sample: Sample) -> Iterable[Output]:
        """Take a Pointcloud: Piece of the map, in its frame; pieces add up, one of another frame begins a new map."""

    @abstractmethod
    def on_dem(self, sample: Sample) -> Iterable[Output]:
        """Take a ElevationMap: Piece of the map as an elevation map: its cells' mean heights."""

    @abstractmethod
    def on_graph_map(self, sample: Sample) -> Iterable[Output]:
        """Take a LidarMap: A map as lidar_slam exports it: key frames, their clouds and the graph that places them;
        replaces the map before it.
        """

    @abstractmethod
    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: Dead reckoning T_odom_base between sweeps and during them."""

    @abstractmethod
    def on_guess(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: T_map_base to begin from; the next sweep believes it within its
        covariance.
        """

    @abstractmethod
    def get_local_map(self) -> Pointcloud:
        """The map around the estimate as the sweep is matched with it."""

    @abstractmethod
    def relocalise(self) -> None:
        """Forget the estimate: the next sweep is searched for on the whole map."""

    @abstractmethod
    def forget_map(self) -> None:
        """Forget map and estimate."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC AbsoluteLocalisation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import ElevationMap, TransformWithCovariance


class AbsoluteLocalisationInterface(Dfpc):
    """Estimate the pose of the robot on an orbital elevation model. The elevation map of each path
    segment is matched with the model, the matches along a traverse are fused, and ambiguous or
    unexplained results are refused.
    """

    name = "absolute_localisation"
    INPUT_PORTS = ("dem", "orbital", "poses", "odometry")

    @abstractmethod
    def on_dem(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type ElevationMap. Elevation patches in the frame of the robot's own
        poses; each measurement must be in one patch only. If a map contains only the layer mean,
        each cell counts as one measurement.
        """

    @abstractmethod
    def on_orbital(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type ElevationMap. The orbital model, layer mean; from the DPM or a
        GeoTIFF, stored until the next one.
        """

    @abstractmethod
    def on_poses(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_map_base of the robot, with which the
        patches were computed; without it the output is T_orbital_map.
        """

    @abstractmethod
    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. T_odom_base of wheel odometry, which does
        not jump; used to measure jumps of the input poses.
        """

    @abstractmethod
    def get_correction(self) -> TransformWithCovariance:
        """The last T_orbital_map, from the robot's own frame to the orbital model."""

    @abstractmethod
    def get_map(self) -> ElevationMap:
        """Map since the last match."""

    @abstractmethod
    def forget(self) -> None:
        """Clear map and hypotheses, keep the orbital model."""

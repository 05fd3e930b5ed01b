# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC AbsoluteLocalisation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.errors import InputError
from cdff_common.interfaces.dfpc import Dfpc, Output, Sample
from cdff_common.types import ElevationMap, TransformWithCovariance


class AbsoluteLocalisationInterface(Dfpc):
    """Where the robot is on an orbital elevation model: what it has mapped on its way is matched with it, the
    matches of a traverse are fused, and what cannot be told apart or stood for is refused.
    """

    name = "absolute_localisation"
    INPUT_PORTS = ("dem", "orbital", "poses", "odometry")

    def step(self, sample: Sample) -> Iterable[Output]:
        """Hand the sample to the handler of its port; raises InputError on a port that is not there."""
        match sample.port:
            case "dem":
                return self.on_dem(sample)
            case "orbital":
                return self.on_orbital(sample)
            case "poses":
                return self.on_poses(sample)
            case "odometry":
                return self.on_odometry(sample)
            case _:
                raise InputError(f"{self.name}: no input port {sample.port!r}; it has {', '.join(self.INPUT_PORTS)}")

    @abstractmethod
    def on_dem(self, sample: Sample) -> Iterable[Output]:
        """Take a ElevationMap: Elevation patches that hold each measurement once, placed by the robot's own poses."""

    @abstractmethod
    def on_orbital(self, sample: Sample) -> Iterable[Output]:
        """Take a ElevationMap: The orbital model, layer mean, cells at least as large as the patches'; from the DPM
        or a GeoTIFF, kept until the next one.
        """

    @abstractmethod
    def on_poses(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: The robot's own T_map_base, that placed the patches; without it what is
        answered is T_orbital_map.
        """

    @abstractmethod
    def on_odometry(self, sample: Sample) -> Iterable[Output]:
        """Take a TransformWithCovariance: T_odom_base of the wheels, which does not jump: tells how far the frame of
        poses jumped where a fix went into them.
        """

    @abstractmethod
    def get_correction(self) -> TransformWithCovariance:
        """T_orbital_map as last answered: what brings the robot's own frame onto the orbital model."""

    @abstractmethod
    def get_map(self) -> ElevationMap:
        """What was mapped since the last match."""

    @abstractmethod
    def forget(self) -> None:
        """Forget map and hypotheses, keep the orbital model."""

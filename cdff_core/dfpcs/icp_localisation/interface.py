# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC IcpLocalisation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class IcpLocalisationInterface(Dfpc):
    """Determine the pose of a model cloud (an object, a map, an earlier scan) in a scene cloud by
    iterative closest points, coarse to fine, starting from a guess or from the identity; an
    uncertain result is refused.
    """

    name = "icp_localisation"
    INPUT_PORTS = ("scene", "model", "guess")

    @abstractmethod
    def on_scene(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Pointcloud. Cloud of the sensor; each scene yields one pose."""

    @abstractmethod
    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Pointcloud. Cloud to localise in the scene; stored until the next
        one.
        """

    @abstractmethod
    def on_guess(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type TransformWithCovariance. Initial T_scene_model; default: the last
        alignment, or the identity.
        """

    @abstractmethod
    def forget(self) -> None:
        """Clear the guess and the last alignment: the next scene starts from the identity."""

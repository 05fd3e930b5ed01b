# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC ShotLocalisation."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class ShotLocalisationInterface(Dfpc):
    """Determine the pose of a model cloud (an object, a map, an earlier scan) in a scene cloud by SHOT
    descriptors, without a guess; an uncertain result is refused.
    """

    name = "shot_localisation"
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
        """Process an input of type TransformWithCovariance. T_scene_model that is tried first, before
        the descriptors are matched.
        """

    @abstractmethod
    def forget(self) -> None:
        """Clear the guess."""

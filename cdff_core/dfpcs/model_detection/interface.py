# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfpc.yaml by cdff generate; do not edit.
"""Interface of the DFPC ModelDetection."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from cdff_common.interfaces.dfpc import Dfpc, Output, Sample


class ModelDetectionInterface(Dfpc):
    """Find one or more known objects (a tool, a rock, a component of a rover) in a depth image and
    determine their poses from their meshes, without a guess. No pose is reported for an object that
    is not in the image.
    """

    name = "model_detection"
    INPUT_PORTS = ("model", "depth")

    @abstractmethod
    def on_model(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type Mesh. Mesh of an object, whose frame is {name}/body; stored until a
        new mesh of this name arrives.
        """

    @abstractmethod
    def on_depth(self, sample: Sample) -> Iterable[Output]:
        """Process an input of type DistanceImage. Depths along the optical axis, 0 without a
        measurement; each image yields one list of detections.
        """

    @abstractmethod
    def clear_models(self) -> None:
        """Remove all models."""

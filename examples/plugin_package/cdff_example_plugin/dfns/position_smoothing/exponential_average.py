# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ExponentialAverage: weighted mean of the measured and the previous smoothed position."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_example_plugin.dfns.position_smoothing.interface import (
    PositionSmoothingInputs,
    PositionSmoothingInterface,
    PositionSmoothingOutputs,
)


class ExponentialAverageConfig(DfnConfig):
    """Parameters of ExponentialAverage."""

    weight: Annotated[float, Field(gt=0, le=1, description="weight of the measured position")] = 0.2


class ExponentialAverage(PositionSmoothingInterface[ExponentialAverageConfig]):
    """First-order recursive filter, ``s = w x + (1 - w) s_previous``."""

    def process(self, inputs: PositionSmoothingInputs) -> PositionSmoothingOutputs:
        """Return the smoothed position; the first one is the measured position itself."""
        previous = inputs.position if inputs.previous is None else inputs.previous
        weight = self.config.weight
        return PositionSmoothingOutputs(smoothed=weight * inputs.position + (1.0 - weight) * previous)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Blocks of pixels become their mean."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.image_degradation._interface import (
    ImageDegradationInputs,
    ImageDegradationInterface,
    ImageDegradationOutputs,
)
from cdff_core.imaging.resizing import shrunk


class AreaAverageConfig(DfnConfig):
    """Size of the blocks."""

    columns_per_pixel: int = Field(2, ge=1, le=64, description="Columns that become one, px")
    rows_per_pixel: int = Field(2, ge=1, le=64, description="Rows that become one, px")


class AreaAverage(ImageDegradationInterface):
    """Mean of each block: no aliasing, and noise falls with its size."""

    Config: ClassVar[type[DfnConfig]] = AreaAverageConfig

    def process(self, inputs: ImageDegradationInputs) -> ImageDegradationOutputs:
        """Return the smaller image; raises InputError where it is smaller than one block."""
        image = shrunk(inputs.image, self.config.columns_per_pixel, self.config.rows_per_pixel)
        return ImageDegradationOutputs(image=image)

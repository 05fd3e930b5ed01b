# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Blocks of pixels become their mean."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.stereo_degradation._interface import (
    StereoDegradationInputs,
    StereoDegradationInterface,
    StereoDegradationOutputs,
)
from cdff_core.imaging.resizing import shrunk


class AreaAverageConfig(DfnConfig):
    """Size of the blocks."""

    columns_per_pixel: int = Field(2, ge=1, le=64, description="Columns that become one, px")
    rows_per_pixel: int = Field(2, ge=1, le=64, description="Rows that become one, px")


class AreaAverage(StereoDegradationInterface):
    """Mean of each block: no aliasing, and noise falls with its size."""

    Config: ClassVar[type[DfnConfig]] = AreaAverageConfig

    def process(self, inputs: StereoDegradationInputs) -> StereoDegradationOutputs:
        """Return the smaller pair; raises InputError where its images differ or are too small."""
        pair, block = inputs.pair, (self.config.columns_per_pixel, self.config.rows_per_pixel)
        if pair.left.image.shape != pair.right.image.shape:
            raise InputError(f"left {pair.left.image.shape}, right {pair.right.image.shape}: expected one size")
        small = replace(pair, left=shrunk(pair.left, *block), right=shrunk(pair.right, *block))
        return StereoDegradationOutputs(pair=small)

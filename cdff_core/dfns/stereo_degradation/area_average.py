# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reduction of a stereo pair by averaging blocks of pixels."""

from __future__ import annotations

from dataclasses import replace

from cdff_common.errors import InputError
from cdff_core.dfns.stereo_degradation.interface import Inputs, Interface, Outputs
from cdff_core.imaging.resizing import BlockConfig, reduce_image


class AreaAverage(Interface[BlockConfig]):
    """Average the pixels of each block, which avoids aliasing and reduces noise."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the smaller pair; raises InputError if its images differ in size or are too small."""
        pair = inputs.pair
        if pair.left.image.shape != pair.right.image.shape:
            raise InputError(
                f"left {pair.left.image.shape}, right {pair.right.image.shape}: expected the same size"
            )
        left, right = (reduce_image(image, self.config) for image in (pair.left, pair.right))
        return Outputs(pair=replace(pair, left=left, right=right))

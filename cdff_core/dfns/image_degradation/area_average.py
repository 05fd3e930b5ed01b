# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reduction of an image by averaging blocks of pixels."""

from __future__ import annotations

from cdff_core.dfns.image_degradation.interface import Inputs, Interface, Outputs
from cdff_core.imaging.resizing import BlockConfig, reduce_image


class AreaAverage(Interface[BlockConfig]):
    """Mean of each block, which avoids aliasing and reduces noise."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the reduced image; raises InputError if the input is smaller than one block."""
        return Outputs(image=reduce_image(inputs.image, self.config))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Contrast spread tile by tile, for shadows and glare.

References
----------
.. [1] Zuiderveld, K. (1994). Contrast limited adaptive histogram equalization. Graphics Gems IV.
   doi:10.1016/B978-0-12-336156-1.50061-6
"""

from __future__ import annotations

from typing import ClassVar

import cv2
import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.image_filtering._interface import (
    ImageFilteringInputs,
    ImageFilteringInterface,
    ImageFilteringOutputs,
)
from cdff_core.imaging.frames import with_image


class LocalContrastConfig(DfnConfig):
    """Tiles and the limit of their gain."""

    tiles: int = Field(8, ge=1, le=64, description="Tiles along each side")
    clip_limit: float = Field(3.0, gt=0.0, le=100.0, description="How many times more than evenly a level may count")


class LocalContrast(ImageFilteringInterface):
    """Histogram equalisation of tiles with a limited gain [1]_; of grey images."""

    Config: ClassVar[type[DfnConfig]] = LocalContrastConfig

    def setup(self) -> None:
        """Make the equaliser."""
        self._equaliser = cv2.createCLAHE(self.config.clip_limit, (self.config.tiles,) * 2)

    def process(self, inputs: ImageFilteringInputs) -> ImageFilteringOutputs:
        """Return the equalised image; raises InputError where it is not grey of 8 or 16 bit."""
        image = inputs.image.image
        if image.ndim != 2 or image.dtype not in (np.uint8, np.uint16):
            raise InputError(f"image {image.dtype} {image.shape}: expected grey of 8 or 16 bit")
        return ImageFilteringOutputs(image=with_image(inputs.image, np.asarray(self._equaliser.apply(image))))

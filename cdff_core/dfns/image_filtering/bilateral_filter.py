# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Smoothing that stops at edges.

References
----------
.. [1] Tomasi, C., Manduchi, R. (1998). Bilateral filtering for gray and color images. ICCV.
   doi:10.1109/ICCV.1998.710815
"""

from __future__ import annotations

from typing import ClassVar

import cv2
import numpy as np
from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.image_filtering._interface import (
    ImageFilteringInputs,
    ImageFilteringInterface,
    ImageFilteringOutputs,
)
from cdff_core.imaging.frames import with_image
from cdff_core.imaging.pixels import eight_bit


class BilateralFilterConfig(DfnConfig):
    """Width in space and in grey levels."""

    sigma_px: float = Field(3.0, gt=0.0, le=20.0, description="Width of the smoothing kernel, px")
    sigma_grey: float = Field(25.0, gt=0.0, le=255.0, description="Difference at which neighbours stop to count")


class BilateralFilter(ImageFilteringInterface):
    """Mean of the neighbours weighted by distance and by likeness [1]_."""

    Config: ClassVar[type[DfnConfig]] = BilateralFilterConfig

    def process(self, inputs: ImageFilteringInputs) -> ImageFilteringOutputs:
        """Return the smoothed image; raises InputError where it is not of 8 bit."""
        c = self.config
        image = cv2.bilateralFilter(eight_bit(inputs.image), -1, c.sigma_grey, c.sigma_px)
        return ImageFilteringOutputs(image=with_image(inputs.image, np.asarray(image)))

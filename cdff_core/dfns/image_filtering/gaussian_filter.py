# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Smoothing with a Gaussian."""

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


class GaussianFilterConfig(DfnConfig):
    """Width of the kernel."""

    sigma_px: float = Field(1.0, gt=0.0, le=50.0, description="Width of the smoothing kernel, px")


class GaussianFilter(ImageFilteringInterface):
    """Weighted mean of the neighbours; edges are reflected."""

    Config: ClassVar[type[DfnConfig]] = GaussianFilterConfig

    def process(self, inputs: ImageFilteringInputs) -> ImageFilteringOutputs:
        """Return the smoothed image; raises InputError where it is not of 8 bit."""
        image = cv2.GaussianBlur(eight_bit(inputs.image), (0, 0), self.config.sigma_px)
        return ImageFilteringOutputs(image=with_image(inputs.image, np.asarray(image)))

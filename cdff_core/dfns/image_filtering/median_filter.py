# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Smoothing with the median."""

from __future__ import annotations

from typing import ClassVar

import cv2
import numpy as np
from pydantic import Field

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.image_filtering._interface import (
    ImageFilteringInputs,
    ImageFilteringInterface,
    ImageFilteringOutputs,
)
from cdff_core.imaging.frames import with_image
from cdff_core.imaging.pixels import eight_bit


class MedianFilterConfig(DfnConfig):
    """Size of the window."""

    window_px: int = Field(3, ge=3, le=99, description="Edge of the window, px; odd")


class MedianFilter(ImageFilteringInterface):
    """Median of a square window: single bad pixels go, edges stay."""

    Config: ClassVar[type[DfnConfig]] = MedianFilterConfig

    def setup(self) -> None:
        """Refuse an even window."""
        if self.config.window_px % 2 == 0:
            raise ConfigurationError(f"MedianFilter: window_px={self.config.window_px}: expected an odd number")

    def process(self, inputs: ImageFilteringInputs) -> ImageFilteringOutputs:
        """Return the filtered image; raises InputError where it is not of 8 bit."""
        image = cv2.medianBlur(eight_bit(inputs.image), self.config.window_px)
        return ImageFilteringOutputs(image=with_image(inputs.image, np.asarray(image)))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Derivatives of the grey levels."""

from __future__ import annotations

from typing import ClassVar, Literal

import cv2
import numpy as np
from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import FrameModeT
from cdff_core.dfns.image_filtering._interface import (
    ImageFilteringInputs,
    ImageFilteringInterface,
    ImageFilteringOutputs,
)
from cdff_core.imaging.frames import with_image
from cdff_core.imaging.grey import grey_image

#: Scharr's kernels add up to this much per grey level and pixel.
_SCALE = 1.0 / 32.0


class DerivativeEdgeDetectionConfig(DfnConfig):
    """Direction and smoothing."""

    direction: Literal["x", "y", "magnitude"] = Field("magnitude", description="Derivative along x or y, or of both")
    sigma_px: float = Field(1.0, ge=0.0, le=50.0, description="Width of the smoothing kernel, px; 0 smooths nothing")


class DerivativeEdgeDetection(ImageFilteringInterface):
    """Scharr's derivatives, grey levels per pixel."""

    Config: ClassVar[type[DfnConfig]] = DerivativeEdgeDetectionConfig

    def process(self, inputs: ImageFilteringInputs) -> ImageFilteringOutputs:
        """Return the derivative, float32; raises InputError where the image is not of 8 bit."""
        grey = grey_image(inputs.image).astype(np.float32)
        if self.config.sigma_px:
            grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), self.config.sigma_px), dtype=np.float32)
        along = {d: cv2.Scharr(grey, cv2.CV_32F, int(d == "x"), int(d == "y"), scale=_SCALE) for d in "xy"}
        along["magnitude"] = np.hypot(along["x"], along["y"])
        made = np.asarray(along[self.config.direction])
        return ImageFilteringOutputs(image=with_image(inputs.image, made, mode=FrameModeT.MODE_UNDEF))

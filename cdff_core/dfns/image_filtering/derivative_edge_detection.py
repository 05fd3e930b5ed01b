# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Derivatives of the grey levels."""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import FrameModeT
from cdff_core.dfns.image_filtering.interface import Inputs, Interface, Outputs
from cdff_core.imaging.frames import with_image
from cdff_core.imaging.grey import grey_image

#: Scharr's kernels add up to this much per grey level and pixel.
_SCALE = 1.0 / 32.0


class DerivativeEdgeDetectionConfig(DfnConfig):
    """Direction and smoothing."""

    direction: Literal["x", "y", "magnitude"] = Field("magnitude", description="Derivative or its magnitude")
    sigma_px: float = Field(
        1.0, ge=0, le=50, description="Standard deviation of the smoothing; 0 disables it"
    )


class DerivativeEdgeDetection(Interface[DerivativeEdgeDetectionConfig]):
    """Scharr's derivatives, grey levels per pixel."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the derivative, float32; raises InputError if the image is not of 8 bit."""
        grey = grey_image(inputs.image).astype(np.float32)
        if self.config.sigma_px:
            grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), self.config.sigma_px), dtype=np.float32)
        along = {d: cv2.Scharr(grey, cv2.CV_32F, int(d == "x"), int(d == "y"), scale=_SCALE) for d in "xy"}
        along["magnitude"] = np.hypot(along["x"], along["y"])
        made = np.asarray(along[self.config.direction])
        return Outputs(image=with_image(inputs.image, made, mode=FrameModeT.MODE_UNDEF))

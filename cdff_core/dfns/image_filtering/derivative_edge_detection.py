# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Edge detection by derivatives of the grey levels."""

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

#: Factor from the response of a Scharr kernel to grey levels per pixel.
_SCALE = 1.0 / 32.0


class DerivativeEdgeDetectionConfig(DfnConfig):
    """Parameters of DerivativeEdgeDetection."""

    direction: Literal["x", "y", "magnitude"] = Field(
        "magnitude", description="Derivative along x, along y, or the magnitude of the gradient"
    )
    sigma_px: float = Field(
        1.0, ge=0, le=50, description="Standard deviation of the smoothing; 0 disables it"
    )


class DerivativeEdgeDetection(Interface[DerivativeEdgeDetectionConfig]):
    """Derivatives by Scharr kernels, in grey levels per pixel."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the derivative, float32; raises InputError if the image is not of 8 bit."""
        grey = grey_image(inputs.image).astype(np.float32)
        if self.config.sigma_px:
            grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), self.config.sigma_px), dtype=np.float32)
        derivatives = {
            d: cv2.Scharr(grey, cv2.CV_32F, int(d == "x"), int(d == "y"), scale=_SCALE) for d in "xy"
        }
        derivatives["magnitude"] = np.hypot(derivatives["x"], derivatives["y"])
        result = np.asarray(derivatives[self.config.direction])
        return Outputs(image=with_image(inputs.image, result, mode=FrameModeT.MODE_UNDEF))

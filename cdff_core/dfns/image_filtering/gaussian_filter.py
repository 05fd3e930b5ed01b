# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gaussian smoothing."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.arrays import Float32Array
from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.image_filtering.interface import Inputs, Interface, Outputs
from cdff_core.imaging.frames import with_image


class GaussianFilterConfig(DfnConfig):
    """Parameters of GaussianFilter."""

    sigma_px: float = Field(1.0, gt=0, le=50, description="Standard deviation of the smoothing kernel")


class GaussianFilter(Interface[GaussianFilterConfig]):
    """Weighted mean of the neighbours; edges are reflected.

    For a depth or disparity image (float32, NaN where not measured) the mean is over the measured neighbours
    (normalised convolution [1]_): gaps remain gaps and do not affect their neighbours.

    References
    ----------
    .. [1] H. Knutsson, C.-F. Westin, Normalized and differential convolution, CVPR 1993,
       doi:10.1109/CVPR.1993.341081
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the smoothed image; raises InputError unless it is 8 bit or float32 with one channel."""
        image = inputs.image.image
        if image.ndim == 2 and image.dtype == np.float32:
            return Outputs(image=with_image(inputs.image, self._of_measured(image)))
        if image.dtype != np.uint8 or (image.ndim == 3 and image.shape[2] != 3):
            raise InputError(f"image {image.dtype} {image.shape}: expected 8 bit, grey or three colours")
        return Outputs(image=with_image(inputs.image, self._blurred(image)))

    def _blurred(self, image: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(cv2.GaussianBlur(np.ascontiguousarray(image), (0, 0), self.config.sigma_px))

    def _of_measured(self, image: Float32Array) -> Float32Array:
        known = np.isfinite(image)
        weight = self._blurred(known.astype(np.float32))
        total = self._blurred(np.where(known, image, np.float32(0.0)))
        return np.asarray(np.divide(total, weight, out=np.full_like(image, np.nan), where=known))

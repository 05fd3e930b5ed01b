# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gaussian smoothing of images, and of depth or disparity images with gaps."""

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
    """Gaussian-weighted mean of the neighbours; the image is reflected at its borders.

    For a depth or disparity image (float32, NaN where not measured) the mean is over the measured neighbours
    only (normalised convolution [1]_). Gaps are not filled and do not affect their neighbours.

    References
    ----------
    .. [1] H. Knutsson, C.-F. Westin, Normalized and differential convolution, CVPR 1993,
       doi:10.1109/CVPR.1993.341081
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the smoothed image; raises InputError unless it is 8 bit or float32 with one channel."""
        image = inputs.image.image
        if image.ndim == 2 and image.dtype == np.float32:
            return Outputs(image=with_image(inputs.image, self._blur_measured(image)))
        if image.dtype != np.uint8 or (image.ndim == 3 and image.shape[2] != 3):
            raise InputError(f"image {image.dtype} {image.shape}: expected 8 bit, grey or three colours")
        return Outputs(image=with_image(inputs.image, self._blur(image)))

    def _blur(self, image: NDArray[Any]) -> NDArray[Any]:
        """Return the image convolved with the Gaussian."""
        return np.asarray(cv2.GaussianBlur(np.ascontiguousarray(image), (0, 0), self.config.sigma_px))

    def _blur_measured(self, image: Float32Array) -> Float32Array:
        """Return the normalised convolution of an image with NaN gaps."""
        is_measured = np.isfinite(image)
        weight = self._blur(is_measured.astype(np.float32))
        weighted_sum = self._blur(np.where(is_measured, image, np.float32(0.0)))
        return np.asarray(np.divide(weighted_sum, weight, out=np.full_like(image, np.nan), where=is_measured))

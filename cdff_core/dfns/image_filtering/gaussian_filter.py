# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Smoothing with a Gaussian."""

from __future__ import annotations

from typing import Any, ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray
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
    """Weighted mean of the neighbours; edges are reflected.

    Of a depth or disparity image (float32, NaN where nothing was measured) the mean is over what was measured
    (normalised convolution [1]_): gaps spoil nothing beside them and stay gaps.

    References
    ----------
    .. [1] H. Knutsson, C.-F. Westin, Normalized and differential convolution, CVPR 1993,
       doi:10.1109/CVPR.1993.341081
    """

    Config: ClassVar[type[DfnConfig]] = GaussianFilterConfig

    def process(self, inputs: ImageFilteringInputs) -> ImageFilteringOutputs:
        """Return the smoothed image; raises InputError where it is neither of 8 bit nor one channel of float32."""
        source = inputs.image.image
        measured = source.ndim == 2 and source.dtype == np.float32
        image = self._of_measured(source) if measured else self._blurred(eight_bit(inputs.image))
        return ImageFilteringOutputs(image=with_image(inputs.image, image))

    def _blurred(self, image: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), self.config.sigma_px))

    def _of_measured(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        known = np.isfinite(image)
        share = self._blurred(known.astype(np.float32))
        total = self._blurred(np.where(known, image, np.float32(0.0)))
        return np.divide(total, share, out=np.full_like(image, np.nan), where=known)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Background model with a mixture of Gaussians for each pixel.

References
----------
.. [1] Zivkovic, Z. (2004). Improved adaptive Gaussian mixture model for background subtraction. ICPR.
   doi:10.1109/ICPR.2004.1333992
"""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import FrameModeT
from cdff_core.dfns.background_subtraction.interface import Inputs, Interface, Outputs
from cdff_core.imaging.frames import with_image

#: Kernel of the morphological opening, which removes foreground regions narrower than 3 px: they are noise.
_OPENING_KERNEL = np.ones((3, 3), np.uint8)


class MixtureOfGaussiansConfig(DfnConfig):
    """Parameters of MixtureOfGaussians."""

    history: int = Field(
        100, ge=1, le=100_000, description="Number of images over which the background model adapts"
    )


class MixtureOfGaussians(Interface[MixtureOfGaussiansConfig]):
    """OpenCV's MOG2 [1]_ with a morphological opening against noise; the first image is all background."""

    def setup(self) -> None:
        """Reset the background model."""
        self._model = cv2.createBackgroundSubtractorMOG2(self.config.history, detectShadows=False)
        self._shape: tuple[int, ...] | None = None

    def process(self, inputs: Inputs) -> Outputs:
        """Return the foreground mask of one image.

        Raises
        ------
        InputError
            If type or size of the image differ from those of the previous images.
        """
        image = inputs.image.image
        if image.dtype != np.uint8 or (self._shape is not None and image.shape != self._shape):
            raise InputError(
                f"image {image.dtype} {image.shape}: expected uint8 {self._shape or 'of any size'}"
            )
        is_first_image, self._shape = self._shape is None, image.shape
        mask = np.asarray(self._model.apply(image))
        if is_first_image:
            mask = np.zeros_like(mask)
        else:
            mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, _OPENING_KERNEL)
        return Outputs(mask=with_image(inputs.image, mask, mode=FrameModeT.MODE_GRAY))

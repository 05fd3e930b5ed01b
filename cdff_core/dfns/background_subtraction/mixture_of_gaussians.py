# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Each pixel's past as a mixture of Gaussians.

References
----------
.. [1] Zivkovic, Z. (2004). Improved adaptive Gaussian mixture model for background subtraction. ICPR.
   doi:10.1109/ICPR.2004.1333992
"""

from __future__ import annotations

from typing import ClassVar

import cv2
import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import FrameModeT
from cdff_core.dfns.background_subtraction._interface import (
    BackgroundSubtractionInputs,
    BackgroundSubtractionInterface,
    BackgroundSubtractionOutputs,
)
from cdff_core.imaging.frames import with_image


class MixtureOfGaussiansConfig(DfnConfig):
    """How fast the background adapts and what counts as different."""

    history: int = Field(100, ge=1, le=100_000, description="Images after which the background has adapted")
    variance_threshold: float = Field(16.0, gt=0.0, le=1e4, description="Squared Mahalanobis distance of foreground")
    detect_shadows: bool = Field(False, description="Whether shadows are told apart")
    opening_px: int = Field(3, ge=0, le=31, description="Edge of the specks that are removed, px; 0 removes none")


class MixtureOfGaussians(BackgroundSubtractionInterface):
    """OpenCV's MOG2 [1]_, then an opening against specks. The first image is background."""

    Config: ClassVar[type[DfnConfig]] = MixtureOfGaussiansConfig

    def setup(self) -> None:
        """Forget what was seen."""
        c = self.config
        self._model = cv2.createBackgroundSubtractorMOG2(c.history, c.variance_threshold, c.detect_shadows)
        self._shape: tuple[int, ...] | None = None

    def process(self, inputs: BackgroundSubtractionInputs) -> BackgroundSubtractionOutputs:
        """Return the mask of one image; raises InputError where it is not like the ones before."""
        image = inputs.image.image
        if image.dtype != np.uint8 or (self._shape is not None and image.shape != self._shape):
            raise InputError(f"image {image.dtype} {image.shape}: expected uint8 {self._shape or 'of any size'}")
        first, self._shape = self._shape is None, image.shape
        mask = np.asarray(self._model.apply(image))
        if first:
            mask = np.zeros_like(mask)
        elif self.config.opening_px:
            mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((self.config.opening_px,) * 2, np.uint8))
        return BackgroundSubtractionOutputs(mask=with_image(inputs.image, mask, mode=FrameModeT.MODE_GRAY))

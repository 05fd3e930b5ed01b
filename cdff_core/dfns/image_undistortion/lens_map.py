# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Each pixel of the ideal image is fetched from where the lens put it."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from cdff_common.camera import CameraModel
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.image_undistortion._interface import (
    ImageUndistortionInputs,
    ImageUndistortionInterface,
    ImageUndistortionOutputs,
)
from cdff_core.imaging.frames import INTERPOLATIONS, with_image
from cdff_core.imaging.rectification import undistorted


class LensMapConfig(DfnConfig):
    """What part of the view is kept."""

    keep: float = Field(0.0, ge=0.0, le=1.0, description="0: every pixel is seen, 1: nothing is lost")
    interpolation: Literal["nearest", "linear", "cubic"] = Field("linear", description="Between pixels")


class LensMap(ImageUndistortionInterface):
    """Map of the lens, made once per calibration and kept."""

    Config: ClassVar[type[DfnConfig]] = LensMapConfig

    def process(self, inputs: ImageUndistortionInputs) -> ImageUndistortionOutputs:
        """Return the image of the ideal camera; raises InputError where the image does not say its camera."""
        ideal = undistorted(CameraModel.of_frame(inputs.image), self.config.keep)
        image = ideal.apply(inputs.image.image, INTERPOLATIONS[self.config.interpolation])
        return ImageUndistortionOutputs(image=with_image(inputs.image, image, camera=ideal.camera))

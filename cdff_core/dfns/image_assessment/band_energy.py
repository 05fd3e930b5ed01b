# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""BandEnergy: contrast by percentiles, sharpness by the energy of two octaves."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.image_assessment._interface import (
    ImageAssessmentInputs,
    ImageAssessmentInterface,
    ImageAssessmentOutputs,
)


class BandEnergyConfig(DfnConfig):
    """Parameters of BandEnergy."""

    step: Annotated[int, Field(ge=1, le=32)] = 2


class BandEnergy(ImageAssessmentInterface):
    """Natural images have about equal energy in every octave [1]_; blur takes the finest ones first.

    Sharpness is the standard deviation of the finest octave of a Laplacian pyramid [2]_ over that of the third, so it
    does not depend on contrast or exposure: 0.5 to 2 for sharp images, about 0.3 when blurred by 2 pixels, 0.1 by 5.

    References
    ----------
    .. [1] D. Field, Relations between the statistics of natural images, JOSA A 4(12), 1987, doi:10.1364/JOSAA.4.002379
    .. [2] P. Burt, E. Adelson, The Laplacian Pyramid, IEEE Trans. Comm. 31(4), 1983, doi:10.1109/TCOM.1983.1095851
    """

    Config = BandEnergyConfig
    config: BandEnergyConfig

    def process(self, inputs: ImageAssessmentInputs) -> ImageAssessmentOutputs:
        """Assess one image; raises InputError on anything but a grey uint8 image."""
        image = inputs.image
        if image.ndim != 2 or image.dtype != np.uint8 or min(image.shape) < 32:
            raise InputError(f"image {image.shape} {image.dtype}: expected (rows, cols) uint8, at least 32 x 32")
        thinned = image[:: self.config.step, :: self.config.step]
        low, high = np.percentile(thinned, [2.0, 98.0])
        change = np.nan
        if inputs.previous is not None:
            if inputs.previous.shape != image.shape:
                raise InputError(f"previous {inputs.previous.shape} and image {image.shape}: expected the same size")
            change = float(cv2.absdiff(np.ascontiguousarray(image), np.ascontiguousarray(inputs.previous)).mean())
        return ImageAssessmentOutputs(
            contrast=np.array([high - low]),
            sharpness=np.array([_sharpness(image)]),
            saturation=np.array([float((thinned == 255).mean())]),
            change=np.array([change]),
        )


def _sharpness(image: NDArray[np.uint8]) -> float:
    levels = [image.astype(np.float32)]
    for _ in range(3):
        levels.append(np.asarray(cv2.pyrDown(levels[-1]), dtype=np.float32))
    bands = [
        float(np.std(fine - cv2.pyrUp(coarse, dstsize=(fine.shape[1], fine.shape[0]))))
        for fine, coarse in pairwise(levels)
    ]
    return bands[0] / bands[2] if bands[2] > 1e-3 else 0.0

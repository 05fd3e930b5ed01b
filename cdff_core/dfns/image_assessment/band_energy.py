# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Contrast by percentiles and sharpness by the energy of two octaves."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from pydantic import Field

from cdff_common.arrays import ByteArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.image_assessment.interface import Inputs, Interface, Outputs
from cdff_core.imaging.grey import checked_image


class BandEnergyConfig(DfnConfig):
    """Parameters of BandEnergy."""

    step: int = Field(
        2, ge=1, le=32, description="Step between the pixels used for contrast and saturation, px"
    )


class BandEnergy(Interface[BandEnergyConfig]):
    """Sharpness as a ratio of band energies: natural images have about equal energy in every octave [1]_.

    Sharpness is the standard deviation of the finest octave of a Laplacian pyramid [2]_ divided by that of
    the third, and thus independent of contrast and exposure. Sharp images have 0.5 to 2, images blurred with
    a standard deviation of 2 pixels about 0.3, of 5 pixels 0.1.

    References
    ----------
    .. [1] D. Field, Relations between the statistics of natural images, JOSA A 4(12), 1987,
      doi:10.1364/JOSAA.4.002379
    .. [2] P. Burt, E. Adelson, The Laplacian Pyramid, IEEE Trans. Comm. 31(4), 1983,
      doi:10.1109/TCOM.1983.1095851
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the assessment of one image; raises InputError on an image that is too small."""
        image = checked_image(inputs.image)
        sampled_pixels = image[:: self.config.step, :: self.config.step]
        low, high = np.percentile(sampled_pixels, [2.0, 98.0])
        change = np.nan
        if inputs.previous is not None:
            change = float(cv2.absdiff(image, np.ascontiguousarray(inputs.previous)).mean())
        return Outputs(
            contrast=high - low,
            sharpness=float(_sharpness(image)),
            saturation=float((sampled_pixels == 255).mean()),
            change=change,
        )


def _sharpness(image: ByteArray) -> float:
    """Return the ratio of the standard deviations of first and third octave; 0 without structure in the
    third.
    """
    levels = [image.astype(np.float32)]
    for _ in range(3):
        levels.append(np.asarray(cv2.pyrDown(levels[-1]), dtype=np.float32))
    bands = [
        float(np.std(fine - cv2.pyrUp(coarse, dstsize=(fine.shape[1], fine.shape[0]))))
        for fine, coarse in pairwise(levels)
    ]
    return bands[0] / bands[2] if bands[2] > 1e-3 else 0.0

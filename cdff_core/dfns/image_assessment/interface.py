# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ImageAssessment."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImageAssessmentInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of uint8, shape (r,c)
        Grey image.
    previous : ndarray of uint8, shape (r,c), optional
        Previous grey image of the same camera.
    """

    ARRAYS = ArrayPorts({"image": "uint8[r,c]", "previous": "uint8[r,c]"}, optional=["previous"])

    image: NDArray[np.uint8]
    previous: NDArray[np.uint8] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImageAssessmentOutputs:
    """Outputs of one call.

    Attributes
    ----------
    contrast : float
        Difference between the 98th and 2nd percentile of the grey levels, DN.
    sharpness : float
        Ratio of the standard deviation of the finest octave to that of the third octave: 0.5 to 2 for a
        sharp image, close to 0 for a blurred image.
    saturation : float
        Fraction of the pixels at 255.
    change : float
        Mean absolute difference from the previous image, DN; NaN without a previous image.
    """

    contrast: float
    sharpness: float
    saturation: float
    change: float


class ImageAssessmentInterface(Dfn[ConfigT, ImageAssessmentInputs, ImageAssessmentOutputs]):
    """Measure contrast, sharpness and saturation of an image and its difference from the previous
    image, to decide whether it is usable.
    """


#: Short names for the implementations.
Inputs = ImageAssessmentInputs
Outputs = ImageAssessmentOutputs
Interface = ImageAssessmentInterface

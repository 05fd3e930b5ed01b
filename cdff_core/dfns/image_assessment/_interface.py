# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ImageAssessment."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class ImageAssessmentInputs:
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of uint8, shape (r,c)
        Grey image.
    previous : ndarray of uint8, shape (r,c), optional
        Grey image of the same camera before it.
    """

    image: NDArray[np.uint8]
    previous: NDArray[np.uint8] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ImageAssessmentOutputs:
    """Outputs of one call.

    Attributes
    ----------
    contrast : ndarray of float64, shape (1)
        Spread of the grey levels between the 2nd and 98th percentile, DN.
    sharpness : ndarray of float64, shape (1)
        Energy of the finest octave over that of the third, 0 for a blurred image, 1.
    saturation : ndarray of float64, shape (1)
        Fraction of the pixels at 255, 1.
    change : ndarray of float64, shape (1)
        Mean absolute difference to the previous image, DN; NaN without one.
    """

    contrast: NDArray[np.float64]
    sharpness: NDArray[np.float64]
    saturation: NDArray[np.float64]
    change: NDArray[np.float64]


class ImageAssessmentInterface(Dfn[Any, ImageAssessmentInputs, ImageAssessmentOutputs]):
    """Say whether an image can be used, by its contrast, its sharpness and what changed since the one before."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN DisparityImage."""

from __future__ import annotations

from dataclasses import dataclass

from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import Frame


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DisparityImageInputs:
    """Inputs of one call.

    Attributes
    ----------
    left : Frame
        Left image, 1, 3 or 4 channels, 8 or 16 bit; rectified: a point lies on the same row in both images.
    right : Frame
        Right image of the same size and depth.
    """

    left: Frame
    right: Frame


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class DisparityImageOutputs:
    """Outputs of one call.

    Attributes
    ----------
    disparity : Frame
        Float32, px: column in the left minus column in the right image, NaN without a match; camera and
        stamp of the left image.
    """

    disparity: Frame


class DisparityImageInterface(Dfn[ConfigT, DisparityImageInputs, DisparityImageOutputs]):
    """Compute the disparity of each pixel of the left image of a rectified stereo pair; NaN for pixels
    without a reliable match.
    """


#: Short names for the implementations.
Inputs = DisparityImageInputs
Outputs = DisparityImageOutputs
Interface = DisparityImageInterface

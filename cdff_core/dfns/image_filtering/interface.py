# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ImageFiltering."""

from __future__ import annotations

from dataclasses import dataclass

from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import Frame


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImageFilteringInputs:
    """Inputs of one call.

    Attributes
    ----------
    image : Frame
        Grey, RGB or BGR image, 8 bit; for GaussianFilter also a depth or disparity image, float32, NaN if
        unknown.
    """

    image: Frame


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImageFilteringOutputs:
    """Outputs of one call.

    Attributes
    ----------
    image : Frame
        Same size, stamp and camera; same channels (GaussianFilter) or one channel: 0 or 255
        (CannyEdgeDetection), float32 grey levels per pixel (DerivativeEdgeDetection).
    """

    image: Frame


class ImageFilteringInterface(Dfn[ConfigT, ImageFilteringInputs, ImageFilteringOutputs]):
    """Smooth an image or detect its edges."""


#: Short names for the implementations.
Inputs = ImageFilteringInputs
Outputs = ImageFilteringOutputs
Interface = ImageFilteringInterface

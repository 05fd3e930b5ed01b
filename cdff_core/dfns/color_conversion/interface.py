# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ColorConversion."""

from __future__ import annotations

from dataclasses import dataclass

from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import Frame


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ColorConversionInputs:
    """Inputs of one call.

    Attributes
    ----------
    image : Frame
        Image in one of the modes GRAY, RGB, RGBA, BGR, BGRA, HSV or HLS; 8 bit, for GRAY and the RGB and
        BGR orders also 16 bit.
    """

    image: Frame


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ColorConversionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    image : Frame
        Same size, depth, stamp and camera in the configured mode.
    """

    image: Frame


class ColorConversionInterface(Dfn[ConfigT, ColorConversionInputs, ColorConversionOutputs]):
    """Convert an image to another channel order or colour space."""


#: Short names for the implementations.
Inputs = ColorConversionInputs
Outputs = ColorConversionOutputs
Interface = ColorConversionInterface

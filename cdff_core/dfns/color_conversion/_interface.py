# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ColorConversion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import Frame


@dataclass(frozen=True, slots=True, eq=False)
class ColorConversionInputs:
    """Inputs of one call.

    Attributes
    ----------
    image : Frame
        Image whose mode says its colours: GRAY, RGB, RGBA, BGR, BGRA, HSV or HLS; 8 bit, for GRAY and the RGB and
        BGR orders also 16 bit.
    """

    image: Frame


@dataclass(frozen=True, slots=True, eq=False)
class ColorConversionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    image : Frame
        Same size, depth, stamp and camera in the mode asked for.
    """

    image: Frame


class ColorConversionInterface(Dfn[Any, ColorConversionInputs, ColorConversionOutputs]):
    """The same image in another order or space of colours."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Colour conversions by OpenCV, via RGB if it has no direct conversion."""

from __future__ import annotations

from typing import Literal

import cv2
import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import FrameModeT
from cdff_core.dfns.color_conversion.interface import Inputs, Interface, Outputs
from cdff_core.imaging.frames import with_image

Mode = Literal["GRAY", "RGB", "RGBA", "BGR", "BGRA", "HSV", "HLS"]
_CHANNELS = {"GRAY": 1, "RGB": 3, "RGBA": 4, "BGR": 3, "BGRA": 4, "HSV": 3, "HLS": 3}
#: Modes that OpenCV converts in 8 bit only.
_EIGHT_BIT = ("HSV", "HLS")


class OpenCvConfig(DfnConfig):
    """Parameters of OpenCv."""

    mode: Mode = Field(
        "GRAY",
        description=(
            "Mode of the output; hue is in steps of 2 degrees, alpha is opaque if the input has no alpha"
        ),
    )


class OpenCv(Interface[OpenCvConfig]):
    """Conversion with the luma of ITU-R BT.601 and hue in steps of 2 degrees, which fits 8 bits."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the converted image; raises InputError if mode or depth cannot be converted."""
        image, target = inputs.image.image, self.config.mode
        source = inputs.image.metadata.mode.name.removeprefix("MODE_")
        channels = 1 if image.ndim == 2 else image.shape[2]
        if source not in _CHANNELS or channels != _CHANNELS[source]:
            raise InputError(
                f"image of {channels} channels in mode {source}: expected one of {', '.join(_CHANNELS)}"
            )
        is_convertible_16_bit = image.dtype == np.uint16 and not {source, target} & set(_EIGHT_BIT)
        if image.dtype != np.uint8 and not is_convertible_16_bit:
            raise InputError(
                f"{source} of {image.dtype} to {target}: expected uint8, or uint16 without HSV and HLS"
            )
        for step in _steps(source, target):
            image = cv2.cvtColor(np.ascontiguousarray(image), getattr(cv2, f"COLOR_{step}"))
        return Outputs(image=with_image(inputs.image, image, mode=FrameModeT[f"MODE_{target}"]))


def _steps(source: str, target: str) -> list[str]:
    """Return the names of the OpenCV conversions to apply in order, such as ``["HSV2RGB", "RGB2GRAY"]``."""
    if source == target:
        return []
    for path in ([f"{source}2{target}"], [f"{source}2RGB", f"RGB2{target}"]):
        if all(hasattr(cv2, f"COLOR_{step}") for step in path):
            return path
    raise InputError(f"no conversion from {source} to {target}")

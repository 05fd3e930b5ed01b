# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ImageUndistortion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import Frame


@dataclass(frozen=True, slots=True, eq=False)
class ImageUndistortionInputs:
    """Inputs of one call.

    Attributes
    ----------
    image : Frame
        Image with its camera: pinhole with distortion coefficients, or fisheye.
    """

    image: Frame


@dataclass(frozen=True, slots=True, eq=False)
class ImageUndistortionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    image : Frame
        Same size, depth and stamp; pinhole without distortion, its camera matrix is the new one; 0 where the lens
        saw nothing.
    """

    image: Frame


class ImageUndistortionInterface(Dfn[Any, ImageUndistortionInputs, ImageUndistortionOutputs]):
    """The image that a camera without distortion would have taken, looking the same way."""

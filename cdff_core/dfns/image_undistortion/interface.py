# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ImageUndistortion."""

from __future__ import annotations

from dataclasses import dataclass

from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import Frame


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImageUndistortionInputs:
    """Inputs of one call.

    Attributes
    ----------
    image : Frame
        Image with its camera: pinhole with distortion, fisheye, omnidirectional, field-of-view or division
        lens.
    """

    image: Frame


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImageUndistortionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    image : Frame
        Same size, depth and stamp; pinhole without distortion, with the new camera matrix; 0 outside the
        view of the lens.
    """

    image: Frame


class ImageUndistortionInterface(Dfn[ConfigT, ImageUndistortionInputs, ImageUndistortionOutputs]):
    """Resample an image to the image of a pinhole camera with the same orientation and without
    distortion.
    """


#: Short names for the implementations.
Inputs = ImageUndistortionInputs
Outputs = ImageUndistortionOutputs
Interface = ImageUndistortionInterface

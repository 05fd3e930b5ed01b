# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ImageDegradation."""

from __future__ import annotations

from dataclasses import dataclass

from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import Frame


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImageDegradationInputs:
    """Inputs of one call.

    Attributes
    ----------
    image : Frame
        Image of any depth and number of channels.
    """

    image: Frame


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ImageDegradationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    image : Frame
        Mean of each block of columns_per_pixel x rows_per_pixel, incomplete blocks at the right and lower
        edge are removed; the camera matrix is adapted.
    """

    image: Frame


class ImageDegradationInterface(Dfn[ConfigT, ImageDegradationInputs, ImageDegradationOutputs]):
    """Reduce the resolution of an image."""


#: Short names for the implementations.
Inputs = ImageDegradationInputs
Outputs = ImageDegradationOutputs
Interface = ImageDegradationInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN BackgroundSubtraction."""

from __future__ import annotations

from dataclasses import dataclass

from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import Frame


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BackgroundSubtractionInputs:
    """Inputs of one call.

    Attributes
    ----------
    image : Frame
        Grey or colour image, 8 bit; all images of a series have the same size.
    """

    image: Frame


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BackgroundSubtractionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    mask : Frame
        Same size, stamp and camera, GRAY: 255 foreground, 0 background.
    """

    mask: Frame


class BackgroundSubtractionInterface(Dfn[ConfigT, BackgroundSubtractionInputs, BackgroundSubtractionOutputs]):
    """Segment the pixels of an image of a static camera that differ from the background of the
    previous images.
    """


#: Short names for the implementations.
Inputs = BackgroundSubtractionInputs
Outputs = BackgroundSubtractionOutputs
Interface = BackgroundSubtractionInterface

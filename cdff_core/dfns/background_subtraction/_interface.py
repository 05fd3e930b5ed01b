# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN BackgroundSubtraction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import Frame


@dataclass(frozen=True, slots=True, eq=False)
class BackgroundSubtractionInputs:
    """Inputs of one call.

    Attributes
    ----------
    image : Frame
        Grey or colour image, 8 bit; one of a series of one size.
    """

    image: Frame


@dataclass(frozen=True, slots=True, eq=False)
class BackgroundSubtractionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    mask : Frame
        Same size, stamp and camera, GRAY: 255 foreground, 127 its shadow, 0 background.
    """

    mask: Frame


class BackgroundSubtractionInterface(Dfn[Any, BackgroundSubtractionInputs, BackgroundSubtractionOutputs]):
    """Where an image differs from what a camera that does not move has seen there so far."""

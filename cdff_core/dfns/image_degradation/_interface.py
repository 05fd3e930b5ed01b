# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ImageDegradation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import Frame


@dataclass(frozen=True, slots=True, eq=False)
class ImageDegradationInputs:
    """Inputs of one call.

    Attributes
    ----------
    image : Frame
        Image of any depth and number of channels.
    """

    image: Frame


@dataclass(frozen=True, slots=True, eq=False)
class ImageDegradationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    image : Frame
        Every block of columns_per_pixel x rows_per_pixel as one pixel, what is left over at the right and lower
        edge cut off; camera matrix made to fit.
    """

    image: Frame


class ImageDegradationInterface(Dfn[Any, ImageDegradationInputs, ImageDegradationOutputs]):
    """A smaller image of the same view, for what needs speed more than detail."""

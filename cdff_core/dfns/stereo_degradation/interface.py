# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN StereoDegradation."""

from __future__ import annotations

from dataclasses import dataclass

from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import FramePair


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StereoDegradationInputs:
    """Inputs of one call.

    Attributes
    ----------
    pair : FramePair
        Images of the same size.
    """

    pair: FramePair


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StereoDegradationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pair : FramePair
        Both images, reduced as by ImageDegradation, with the same baseline.
    """

    pair: FramePair


class StereoDegradationInterface(Dfn[ConfigT, StereoDegradationInputs, StereoDegradationOutputs]):
    """Reduce the resolution of a stereo pair; a rectified pair remains rectified."""


#: Short names for the implementations.
Inputs = StereoDegradationInputs
Outputs = StereoDegradationOutputs
Interface = StereoDegradationInterface

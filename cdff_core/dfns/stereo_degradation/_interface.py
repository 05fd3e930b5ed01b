# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN StereoDegradation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import FramePair


@dataclass(frozen=True, slots=True, eq=False)
class StereoDegradationInputs:
    """Inputs of one call.

    Attributes
    ----------
    pair : FramePair
        Images of one size.
    """

    pair: FramePair


@dataclass(frozen=True, slots=True, eq=False)
class StereoDegradationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pair : FramePair
        Both images as ImageDegradation makes them, the same baseline.
    """

    pair: FramePair


class StereoDegradationInterface(Dfn[Any, StereoDegradationInputs, StereoDegradationOutputs]):
    """A smaller stereo pair of the same view; what was rectified stays rectified."""

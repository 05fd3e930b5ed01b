# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PositionSmoothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts
from cdff_common.interfaces.dfn import ConfigT, Dfn

_ARRAYS = ArrayPorts({"position": "float64[3]", "previous": "float64[3]"}, optional=["previous"])


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PositionSmoothingInputs:
    """Inputs of one call.

    Attributes
    ----------
    position : ndarray of float64, shape (3)
        Measured position, metres.
    previous : ndarray of float64, shape (3), optional
        Smoothed position of the previous call, metres.
    """

    position: NDArray[np.float64]
    previous: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        _ARRAYS.check(self)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PositionSmoothingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    smoothed : ndarray of float64, shape (3)
        Smoothed position, metres.
    """

    smoothed: NDArray[np.float64]


class PositionSmoothingInterface(Dfn[ConfigT, PositionSmoothingInputs, PositionSmoothingOutputs]):
    """Low-pass filter of a position."""


#: Short names for the implementations.
Inputs = PositionSmoothingInputs
Outputs = PositionSmoothingOutputs
Interface = PositionSmoothingInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PositionSmoothing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PositionSmoothingInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    position : ndarray of float64, shape (3)
        Measured position, metres.
    previous : ndarray of float64, shape (3), optional
        Smoothed position of the previous call, metres.
    """

    ARRAYS = ArrayPorts({"position": "float64[3]", "previous": "float64[3]"}, optional=["previous"])

    position: NDArray[np.float64]
    previous: NDArray[np.float64] | None = None


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

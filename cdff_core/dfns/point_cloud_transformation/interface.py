# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PointCloudTransformation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointCloudTransformationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points in frame b, metres.
    transform : ndarray of float64, shape (4,4)
        T_a_b.
    """

    ARRAYS = ArrayPorts({"points": "float64[n,3]", "transform": "float64[4,4]"})

    points: NDArray[np.float64]
    transform: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointCloudTransformationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transformed_points : ndarray of float64, shape (n,3)
        Points in frame a, metres.
    """

    transformed_points: NDArray[np.float64]


class PointCloudTransformationInterface(
    Dfn[ConfigT, PointCloudTransformationInputs, PointCloudTransformationOutputs]
):
    """Transform points to another frame."""


#: Short names for the implementations.
Inputs = PointCloudTransformationInputs
Outputs = PointCloudTransformationOutputs
Interface = PointCloudTransformationInterface

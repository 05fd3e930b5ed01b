# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PointCloudFiltering."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointCloudFilteringInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points in the sensor's frame, metres; rows that are not finite are removed.
    """

    ARRAYS = ArrayPorts({"points": "float64[n,3]"})

    points: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointCloudFilteringOutputs:
    """Outputs of one call.

    Attributes
    ----------
    filtered_points : ndarray of float64, shape (m,3)
        Remaining points, in input order, metres.
    kept : ndarray of int64, shape (m)
        Row of each remaining point in the input.
    """

    filtered_points: NDArray[np.float64]
    kept: NDArray[np.int64]


class PointCloudFilteringInterface(Dfn[ConfigT, PointCloudFilteringInputs, PointCloudFilteringOutputs]):
    """Remove unreliable points from a cloud and report the rows of the remaining ones."""


#: Short names for the implementations.
Inputs = PointCloudFilteringInputs
Outputs = PointCloudFilteringOutputs
Interface = PointCloudFilteringInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PointCloudFiltering."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class PointCloudFilteringInputs:
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points in the sensor's frame, metres; rows that are not finite are dropped.
    """

    points: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PointCloudFilteringOutputs:
    """Outputs of one call.

    Attributes
    ----------
    filtered_points : ndarray of float64, shape (m,3)
        Points that were kept, in their order, metres.
    kept : ndarray of int64, shape (m)
        Row of each kept point in the input.
    """

    filtered_points: NDArray[np.float64]
    kept: NDArray[np.int64]


class PointCloudFilteringInterface(Dfn[Any, PointCloudFilteringInputs, PointCloudFilteringOutputs]):
    """Keep the points of a cloud that can be trusted, drop the rest, and say which were kept."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN DemRasterisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import ElevationMap


@dataclass(frozen=True, slots=True, eq=False)
class DemRasterisationInputs:
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points in the frame of the map, z up, metres; rows that are not finite are left out.
    height_variance : ndarray of float64, shape (n), optional
        Variance of each height that the spread in a cell does not show, square metres.
    stamps_ns : ndarray of int64, shape (n), optional
        When each point was measured, nanoseconds; 0 where absent.
    noise_variance : ndarray of float64, shape (n), optional
        Variance of each height by the sensor's own noise, which the spread in a cell shows as far as it holds many
        heights, square metres.
    intensity : ndarray of float64, shape (n), optional
        Brightness of each point, NaN where unknown.
    """

    points: NDArray[np.float64]
    height_variance: NDArray[np.float64] | None = None
    stamps_ns: NDArray[np.int64] | None = None
    noise_variance: NDArray[np.float64] | None = None
    intensity: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class DemRasterisationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    map : ElevationMap
        Smallest grid that holds all points; layers mean, variance, min, max, count, age_s, NaN where unobserved;
        further layers for further inputs: pose_variance (mean of heightVariance), intensity (mean), first_age_s (of
        the oldest), overhang_m (lowest height of what hangs over the cell).
    """

    map: ElevationMap


class DemRasterisationInterface(Dfn[Any, DemRasterisationInputs, DemRasterisationOutputs]):
    """Statistics of the heights of a cloud in each cell of a grid aligned with the cloud's frame; cells without a
    point stay unobserved.
    """

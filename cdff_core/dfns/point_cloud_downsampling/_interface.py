# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PointCloudDownsampling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class PointCloudDownsamplingInputs:
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Finite points, metres.
    edge_m : ndarray of float64, shape (), optional
        Edge of a voxel, metres: overrides the configuration, for clouds that must be thinned alike.
    """

    points: NDArray[np.float64]
    edge_m: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PointCloudDownsamplingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (m,3)
        Mean of the points of each occupied voxel, ordered by voxel, metres.
    voxel_m : ndarray of float64, shape ()
        Edge of the voxels, metres; 0 where the cloud was small enough to pass unchanged.
    """

    points: NDArray[np.float64]
    voxel_m: NDArray[np.float64]


class PointCloudDownsamplingInterface(Dfn[Any, PointCloudDownsamplingInputs, PointCloudDownsamplingOutputs]):
    """Thin a cloud to one mean point per occupied voxel, with a voxel size that is given or found from the number of
    points wanted.
    """

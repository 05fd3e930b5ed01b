# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PointCloudDownsampling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointCloudDownsamplingInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Finite points, metres.
    edge_m : float, optional
        Edge of a voxel, metres; overrides the configuration, for example to give two clouds the same voxel
        size.
    """

    ARRAYS = ArrayPorts({"points": "float64[n,3]"}, positive=["edge_m"], optional=["edge_m"])

    points: NDArray[np.float64]
    edge_m: float | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointCloudDownsamplingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (m,3)
        Mean of the points of each occupied voxel, ordered by voxel, metres.
    voxel_m : float
        Edge of the voxels, metres; 0 if the cloud has few enough points and is unchanged.
    """

    points: NDArray[np.float64]
    voxel_m: float


class PointCloudDownsamplingInterface(
    Dfn[ConfigT, PointCloudDownsamplingInputs, PointCloudDownsamplingOutputs]
):
    """Downsample a cloud to one mean point per occupied voxel, with a given voxel size or one that
    yields a desired number of points.
    """


#: Short names for the implementations.
Inputs = PointCloudDownsamplingInputs
Outputs = PointCloudDownsamplingOutputs
Interface = PointCloudDownsamplingInterface

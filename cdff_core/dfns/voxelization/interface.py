# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN Voxelization."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VoxelizationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Finite points, metres.
    """

    ARRAYS = ArrayPorts({"points": "float64[n,3]"})

    points: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class VoxelizationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    codes : ndarray of int64, shape (m)
        Morton code of each occupied leaf, ascending; the code of its parent is the code shifted right by
        three bits.
    centres : ndarray of float64, shape (m,3)
        Centres of the leaves, metres.
    means : ndarray of float64, shape (m,3)
        Mean of the points of each leaf, metres.
    counts : ndarray of int64, shape (m)
        Number of points of each leaf.
    origin_m : ndarray of float64, shape (3)
        Lowest corner of the root, metres.
    depth : int
        Number of levels below the root; the edge of the root is 2^depth times the edge of a leaf.
    """

    codes: NDArray[np.int64]
    centres: NDArray[np.float64]
    means: NDArray[np.float64]
    counts: NDArray[np.int64]
    origin_m: NDArray[np.float64]
    depth: int


class VoxelizationInterface(Dfn[ConfigT, VoxelizationInputs, VoxelizationOutputs]):
    """Compute the occupied leaves of a cubic octree of a cloud, with the number and mean of their
    points.
    """


#: Short names for the implementations.
Inputs = VoxelizationInputs
Outputs = VoxelizationOutputs
Interface = VoxelizationInterface

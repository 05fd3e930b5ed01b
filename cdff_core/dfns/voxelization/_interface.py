# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN Voxelization."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class VoxelizationInputs:
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Finite points, metres.
    """

    points: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class VoxelizationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    codes : ndarray of int64, shape (m)
        Morton code of each occupied leaf, ascending: its parent's is the code shifted right by three bits.
    centres : ndarray of float64, shape (m,3)
        Centres of the leaves, metres.
    means : ndarray of float64, shape (m,3)
        Mean of the points of each leaf, metres.
    counts : ndarray of int64, shape (m)
        Points of each leaf.
    origin_m : ndarray of float64, shape (3)
        Lowest corner of the root, metres.
    depth : ndarray of int64, shape ()
        Levels below the root: the root's edge is the leaf's times two to this power.
    """

    codes: NDArray[np.int64]
    centres: NDArray[np.float64]
    means: NDArray[np.float64]
    counts: NDArray[np.int64]
    origin_m: NDArray[np.float64]
    depth: NDArray[np.int64]


class VoxelizationInterface(Dfn[Any, VoxelizationInputs, VoxelizationOutputs]):
    """Say which cells of a cubic octree a cloud occupies, how many points lie in each, and what their mean is."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesMatching3D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class FeaturesMatching3DInputs:
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of float32, shape (n,d)
        One descriptor per row.
    target : ndarray of float32, shape (m,d)
        One descriptor per row.
    """

    source: NDArray[np.float32]
    target: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class FeaturesMatching3DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    matches : ndarray of int64, shape (k,2)
        Rows of source and target, by distance ratio ascending.
    distances : ndarray of float32, shape (k)
        Euclidean distance of the descriptors.
    ratios : ndarray of float32, shape (k)
        That distance over the one to the second nearest target: 0 unique, 1 ambiguous.
    """

    matches: NDArray[np.int64]
    distances: NDArray[np.float32]
    ratios: NDArray[np.float32]


class FeaturesMatching3DInterface(Dfn[Any, FeaturesMatching3DInputs, FeaturesMatching3DOutputs]):
    """Pair the descriptors of two clouds that are each other's nearest."""

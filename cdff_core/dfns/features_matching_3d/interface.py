# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesMatching3D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesMatching3DInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of float32, shape (n,d)
        One descriptor per row.
    target : ndarray of float32, shape (m,d)
        One descriptor per row.
    """

    ARRAYS = ArrayPorts({"source": "float32[n,d]", "target": "float32[m,d]"}, finite=["source", "target"])

    source: NDArray[np.float32]
    target: NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesMatching3DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    matches : ndarray of int64, shape (k,2)
        Rows of source and target, by distance ratio ascending.
    distances : ndarray of float32, shape (k)
        Euclidean distance of the descriptors.
    ratios : ndarray of float32, shape (k)
        Ratio of the distance to that of the second nearest target: 0 unique, 1 ambiguous.
    """

    matches: NDArray[np.int64]
    distances: NDArray[np.float32]
    ratios: NDArray[np.float32]


class FeaturesMatching3DInterface(Dfn[ConfigT, FeaturesMatching3DInputs, FeaturesMatching3DOutputs]):
    """Match descriptors of two clouds: a pair is a match if each is the nearest descriptor of the
    other.
    """


#: Short names for the implementations.
Inputs = FeaturesMatching3DInputs
Outputs = FeaturesMatching3DOutputs
Interface = FeaturesMatching3DInterface

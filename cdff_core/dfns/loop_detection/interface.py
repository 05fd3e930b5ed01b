# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN LoopDetection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LoopDetectionInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Points observed from the place, in the frame of the robot there, z approximately up, metres.
    database : ndarray of float32, shape (m,d), optional
        Descriptors of other places; without it no comparison is made.
    """

    ARRAYS = ArrayPorts({"points": "float64[n,3]", "database": "float32[m,d]"}, optional=["database"])

    points: NDArray[np.float64]
    database: NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LoopDetectionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    descriptor : ndarray of float32, shape (d)
        Descriptor of this place, to be stored by the caller.
    relief_m : float
        Standard deviation of the described heights, metres; places are not compared if it is below
        min_relief_m.
    candidates : ndarray of int64, shape (c)
        Rows of similar places in the database, most similar first.
    similarity : ndarray of float64, shape (c)
        Correlation of the heights of each candidate, -1 to 1.
    transforms : ndarray of float64, shape (c,4,4)
        Guess of T_candidate_place: the rotation is accurate to some degrees, the translation is assumed to
        be 0.
    """

    descriptor: NDArray[np.float32]
    relief_m: float
    candidates: NDArray[np.int64]
    similarity: NDArray[np.float64]
    transforms: NDArray[np.float64]


class LoopDetectionInterface(Dfn[ConfigT, LoopDetectionInputs, LoopDetectionOutputs]):
    """Describe a place by the terrain around it, and find similar places among earlier descriptors,
    each with an initial guess of the relative pose. The results are candidates that must be
    verified by registration.
    """


#: Short names for the implementations.
Inputs = LoopDetectionInputs
Outputs = LoopDetectionOutputs
Interface = LoopDetectionInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN LoopDetection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class LoopDetectionInputs:
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        What was seen from a place, in its own frame, z roughly up, metres.
    database : ndarray of float32, shape (m,d), optional
        Descriptors of other places; none are compared where it is absent.
    """

    points: NDArray[np.float64]
    database: NDArray[np.float32] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LoopDetectionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    descriptor : ndarray of float32, shape (d)
        Of this place; to be kept by the caller.
    relief_m : ndarray of float64, shape ()
        Standard deviation of the described heights, metres; where it is below minReliefM nothing is compared.
    candidates : ndarray of int64, shape (c)
        Rows of the database that look alike, most similar first.
    similarity : ndarray of float64, shape (c)
        Of the candidates: correlation of the heights, -1 to 1.
    transforms : ndarray of float64, shape (c,4,4)
        T_candidate_place, a guess: the turn is known to some degrees, the shift is taken as none.
    """

    descriptor: NDArray[np.float32]
    relief_m: NDArray[np.float64]
    candidates: NDArray[np.int64]
    similarity: NDArray[np.float64]
    transforms: NDArray[np.float64]


class LoopDetectionInterface(Dfn[Any, LoopDetectionInputs, LoopDetectionOutputs]):
    """Describe a place by the ground around it, and find which of the places described before look like it, with a
    first guess of how they lie to one another. What it finds are candidates: registration has to verify them.
    """

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN GlobalRegistration3D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class GlobalRegistration3DInputs:
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of float64, shape (n,3)
        Points to be moved, row i paired with row i of the target, metres.
    target : ndarray of float64, shape (n,3)
        Points to be met, metres.
    noise_m : ndarray of float64, shape (), optional
        Largest distance of the two points of a right pair, metres; absent where it is configured.
    """

    source: NDArray[np.float64]
    target: NDArray[np.float64]
    noise_m: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class GlobalRegistration3DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transform : ndarray of float64, shape (4,4)
        T_target_source.
    inliers : ndarray of bool, shape (n)
        Pairs that lie within the noise of the transform.
    clique_size : ndarray of int64, shape ()
        Pairs that are all consistent with one another.
    expected_by_chance : ndarray of float64, shape ()
        Expected number of cliques as large as this one among random pairs: far below 1 where the answer means
        something.
    """

    transform: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    clique_size: NDArray[np.int64]
    expected_by_chance: NDArray[np.float64]


class GlobalRegistration3DInterface(Dfn[Any, GlobalRegistration3DInputs, GlobalRegistration3DOutputs]):
    """Find the rigid transform that most of the given point pairs agree on, from no guess and among mostly wrong
    pairs.
    """

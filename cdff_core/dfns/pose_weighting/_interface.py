# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PoseWeighting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class PoseWeightingInputs:
    """Inputs of one call.

    Attributes
    ----------
    first : ndarray of float64, shape (4,4)
        T_a_b.
    first_covariance : ndarray of float64, shape (6,6)
        Of it: x y z rx ry rz, perturbation in a.
    second : ndarray of float64, shape (4,4)
        T_a_b by somebody else.
    second_covariance : ndarray of float64, shape (6,6)
        Of it, likewise.
    """

    first: NDArray[np.float64]
    first_covariance: NDArray[np.float64]
    second: NDArray[np.float64]
    second_covariance: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PoseWeightingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pose : ndarray of float64, shape (4,4)
        T_a_b joined.
    covariance : ndarray of float64, shape (6,6)
        Of it.
    weight : ndarray of float64, shape ()
        Of the first, 0 to 1; the second has the rest.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    weight: NDArray[np.float64]


class PoseWeightingInterface(Dfn[Any, PoseWeightingInputs, PoseWeightingOutputs]):
    """Weigh two estimates of one pose whose errors may have causes in common, so that the joined covariance is none
    too small whatever they share.
    """

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PoseWeighting."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PoseWeightingInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    first : ndarray of float64, shape (4,4)
        T_a_b.
    first_covariance : ndarray of float64, shape (6,6)
        Covariance of first, [x y z rx ry rz], perturbation in a.
    second : ndarray of float64, shape (4,4)
        T_a_b from another source.
    second_covariance : ndarray of float64, shape (6,6)
        Covariance of second, [x y z rx ry rz], perturbation in a.
    """

    ARRAYS = ArrayPorts(
        {
            "first": "float64[4,4]",
            "first_covariance": "float64[6,6]",
            "second": "float64[4,4]",
            "second_covariance": "float64[6,6]",
        }
    )

    first: NDArray[np.float64]
    first_covariance: NDArray[np.float64]
    second: NDArray[np.float64]
    second_covariance: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PoseWeightingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pose : ndarray of float64, shape (4,4)
        Combined T_a_b.
    covariance : ndarray of float64, shape (6,6)
        Covariance of the pose, [x y z rx ry rz], perturbation in a.
    weight : float
        Weight of the first pose, 0 to 1; the weight of the second is 1 - weight.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    weight: float


class PoseWeightingInterface(Dfn[ConfigT, PoseWeightingInputs, PoseWeightingOutputs]):
    """Combine two estimates of the same pose whose errors have an unknown correlation. The resulting
    covariance is an upper bound for any correlation.
    """


#: Short names for the implementations.
Inputs = PoseWeightingInputs
Outputs = PoseWeightingOutputs
Interface = PoseWeightingInterface

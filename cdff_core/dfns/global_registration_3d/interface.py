# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN GlobalRegistration3D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GlobalRegistration3DInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of float64, shape (n,3)
        Points to transform, metres; row i is paired with row i of the target.
    target : ndarray of float64, shape (n,3)
        Target points, metres.
    noise_m : float, optional
        Largest distance between the two points of an inlier pair, metres; default: the configured value.
    """

    ARRAYS = ArrayPorts(
        {"source": "float64[n,3]", "target": "float64[n,3]"}, positive=["noise_m"], optional=["noise_m"]
    )

    source: NDArray[np.float64]
    target: NDArray[np.float64]
    noise_m: float | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GlobalRegistration3DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transform : ndarray of float64, shape (4,4)
        T_target_source.
    inliers : ndarray of bool, shape (n)
        Pairs within the noise of the transform.
    clique_size : int
        Number of mutually consistent pairs.
    expected_by_chance : float
        Expected number of cliques of this size among random pairs; a result is significant if it is far
        below 1.
    """

    transform: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    clique_size: int
    expected_by_chance: float


class GlobalRegistration3DInterface(Dfn[ConfigT, GlobalRegistration3DInputs, GlobalRegistration3DOutputs]):
    """Estimate the rigid transform supported by the largest set of consistent point pairs, without an
    initial guess; most pairs may be outliers.
    """


#: Short names for the implementations.
Inputs = GlobalRegistration3DInputs
Outputs = GlobalRegistration3DOutputs
Interface = GlobalRegistration3DInterface

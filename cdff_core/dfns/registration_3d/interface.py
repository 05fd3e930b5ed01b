# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN Registration3D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Registration3DInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of float64, shape (n,3)
        Points to transform, metres.
    target : ndarray of float64, shape (m,3)
        Target points, metres.
    target_normals : ndarray of float64, shape (m,3), optional
        Unit normals of the target; default: estimated.
    guess : ndarray of float64, shape (4,4), optional
        Initial T_target_source; default: identity.
    """

    ARRAYS = ArrayPorts(
        {
            "source": "float64[n,3]",
            "target": "float64[m,3]",
            "target_normals": "float64[m,3]",
            "guess": "float64[4,4]",
        },
        finite=["target_normals"],
        optional=["target_normals", "guess"],
    )

    source: NDArray[np.float64]
    target: NDArray[np.float64]
    target_normals: NDArray[np.float64] | None = None
    guess: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Registration3DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transform : ndarray of float64, shape (4,4)
        T_target_source.
    residual_scale_m : float
        Robust standard deviation of the final distances to the surface, metres.
    iterations : int
        Number of iterations.
    converged : bool
        True if the last step was below the tolerance.
    """

    transform: NDArray[np.float64]
    residual_scale_m: float
    iterations: int
    converged: bool


class Registration3DInterface(Dfn[ConfigT, Registration3DInputs, Registration3DOutputs]):
    """Align a source cloud with an overlapping target cloud, from a guess inside the basin of
    convergence. The result may be a local minimum; RegistrationAssessment assesses whether it is
    correct.
    """


#: Short names for the implementations.
Inputs = Registration3DInputs
Outputs = Registration3DOutputs
Interface = Registration3DInterface

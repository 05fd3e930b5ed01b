# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN Registration3D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class Registration3DInputs:
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of float64, shape (n,3)
        Points to be moved, metres.
    target : ndarray of float64, shape (m,3)
        Points to be met, metres.
    target_normals : ndarray of float64, shape (m,3), optional
        Unit normals of the target; estimated where absent.
    guess : ndarray of float64, shape (4,4), optional
        T_target_source to begin from; identity where absent.
    """

    source: NDArray[np.float64]
    target: NDArray[np.float64]
    target_normals: NDArray[np.float64] | None = None
    guess: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Registration3DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transform : ndarray of float64, shape (4,4)
        T_target_source.
    residual_scale_m : ndarray of float64, shape ()
        Robust standard deviation of the distances to the surface at the end, metres.
    iterations : ndarray of int64, shape ()
        Iterations done.
    converged : ndarray of bool, shape ()
        Whether the last step was below the tolerance.
    """

    transform: NDArray[np.float64]
    residual_scale_m: NDArray[np.float64]
    iterations: NDArray[np.int64]
    converged: NDArray[np.bool_]


class Registration3DInterface(Dfn[Any, Registration3DInputs, Registration3DOutputs]):
    """Align a source cloud with a target cloud that it overlaps, from a guess inside the basin of convergence. Says
    what it converged to; whether that is right is RegistrationAssessment's question.
    """

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN NormalsEstimation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class NormalsEstimationInputs:
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Finite points, metres.
    """

    points: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class NormalsEstimationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    normals : ndarray of float64, shape (n,3)
        Unit normals turned towards the viewpoint.
    roughness_m : ndarray of float64, shape (n)
        Standard deviation of the neighbours from the plane, metres.
    """

    normals: NDArray[np.float64]
    roughness_m: NDArray[np.float64]


class NormalsEstimationInterface(Dfn[Any, NormalsEstimationInputs, NormalsEstimationOutputs]):
    """Fit a plane to each point's neighbourhood; give its normal and how far the neighbours lie from it."""

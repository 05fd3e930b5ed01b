# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN NormalsEstimation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NormalsEstimationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Finite points, metres.
    """

    ARRAYS = ArrayPorts({"points": "float64[n,3]"})

    points: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NormalsEstimationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    normals : ndarray of float64, shape (n,3)
        Unit normals oriented towards the viewpoint.
    roughness_m : ndarray of float64, shape (n)
        Standard deviation of the neighbours from the plane, metres.
    """

    normals: NDArray[np.float64]
    roughness_m: NDArray[np.float64]


class NormalsEstimationInterface(Dfn[ConfigT, NormalsEstimationInputs, NormalsEstimationOutputs]):
    """Fit a plane to the neighbourhood of each point; return the normal of the plane and the standard
    deviation of the neighbours from it.
    """


#: Short names for the implementations.
Inputs = NormalsEstimationInputs
Outputs = NormalsEstimationOutputs
Interface = NormalsEstimationInterface

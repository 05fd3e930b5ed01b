# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesExtraction3D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesExtraction3DInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Finite points, metres.
    radius_m : float, optional
        Edge of the cells (Uniform) or radius of the neighbourhoods (Iss, Harris), metres; default: the
        configured value.
    """

    ARRAYS = ArrayPorts({"points": "float64[n,3]"})

    points: NDArray[np.float64]
    radius_m: float | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesExtraction3DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    keypoints : ndarray of float64, shape (k,3)
        Points of the cloud, metres.
    indices : ndarray of int64, shape (k)
        Rows of the keypoints in the cloud, ascending.
    """

    keypoints: NDArray[np.float64]
    indices: NDArray[np.int64]


class FeaturesExtraction3DInterface(Dfn[ConfigT, FeaturesExtraction3DInputs, FeaturesExtraction3DOutputs]):
    """Select the points of a cloud at which descriptors are computed."""


#: Short names for the implementations.
Inputs = FeaturesExtraction3DInputs
Outputs = FeaturesExtraction3DOutputs
Interface = FeaturesExtraction3DInterface

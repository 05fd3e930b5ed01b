# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesExtraction3D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class FeaturesExtraction3DInputs:
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Finite points, metres.
    radius_m : ndarray of float64, shape (), optional
        Edge of the cells (Uniform) or radius of the neighbourhoods (Iss, Harris), metres; absent where it follows
        from the configuration.
    """

    points: NDArray[np.float64]
    radius_m: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FeaturesExtraction3DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    keypoints : ndarray of float64, shape (k,3)
        Points of the cloud, metres.
    indices : ndarray of int64, shape (k)
        Their rows in the cloud, ascending.
    """

    keypoints: NDArray[np.float64]
    indices: NDArray[np.int64]


class FeaturesExtraction3DInterface(Dfn[Any, FeaturesExtraction3DInputs, FeaturesExtraction3DOutputs]):
    """Choose the points of a cloud at which descriptors are worth computing."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesDescription3D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class FeaturesDescription3DInputs:
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Finite points, metres.
    normals : ndarray of float64, shape (n,3)
        Unit normals of the points.
    keypoints : ndarray of float64, shape (k,3)
        Where descriptors are wanted, metres.
    radius_m : ndarray of float64, shape (), optional
        Radius of the support, metres; absent where it follows from the configuration.
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    keypoints: NDArray[np.float64]
    radius_m: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FeaturesDescription3DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    descriptors : ndarray of float32, shape (k,d)
        One row per keypoint: 352 values of unit length (Shot) or 33 values (Fpfh); zeros where it is not valid.
    valid : ndarray of bool, shape (k)
        Whether the support held enough points.
    """

    descriptors: NDArray[np.float32]
    valid: NDArray[np.bool_]


class FeaturesDescription3DInterface(Dfn[Any, FeaturesDescription3DInputs, FeaturesDescription3DOutputs]):
    """Describe the surface around each keypoint by a histogram that does not depend on the pose of the cloud."""

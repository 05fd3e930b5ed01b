# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesDescription3D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesDescription3DInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Finite points, metres.
    normals : ndarray of float64, shape (n,3)
        Unit normals of the points.
    keypoints : ndarray of float64, shape (k,3)
        Positions of the descriptors, metres.
    radius_m : float, optional
        Radius of the support, metres; default: the configured value.
    """

    ARRAYS = ArrayPorts({"points": "float64[n,3]", "normals": "float64[n,3]", "keypoints": "float64[k,3]"})

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    keypoints: NDArray[np.float64]
    radius_m: float | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesDescription3DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    descriptors : ndarray of float32, shape (k,d)
        One row per keypoint: 352 values of unit length (Shot) or 33 values (Fpfh); zeros if invalid.
    valid : ndarray of bool, shape (k)
        False if the support has too few points.
    """

    descriptors: NDArray[np.float32]
    valid: NDArray[np.bool_]


class FeaturesDescription3DInterface(Dfn[ConfigT, FeaturesDescription3DInputs, FeaturesDescription3DOutputs]):
    """Compute a histogram of the surface around each keypoint that is independent of the pose of the
    cloud.
    """


#: Short names for the implementations.
Inputs = FeaturesDescription3DInputs
Outputs = FeaturesDescription3DOutputs
Interface = FeaturesDescription3DInterface

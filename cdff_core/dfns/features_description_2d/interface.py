# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesDescription2D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesDescription2DInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of uint8, shape (r,c)
        Grey image.
    features : ndarray of float64, shape (n,2)
        Column and row of each point, pixels.
    sizes : ndarray of float64, shape (n), optional
        Diameter of each point, pixels; if NaN or absent, the diameter of a corner is used.
    angles : ndarray of float64, shape (n), optional
        Orientation of each keypoint, degrees clockwise from x; if NaN or absent, it is computed from the
        surrounding grey values.
    """

    ARRAYS = ArrayPorts(
        {"image": "uint8[r,c]", "features": "float64[n,2]", "sizes": "float64[n]", "angles": "float64[n]"},
        optional=["sizes", "angles"],
    )

    image: NDArray[np.uint8]
    features: NDArray[np.float64]
    sizes: NDArray[np.float64] | None = None
    angles: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesDescription2DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    descriptors : ndarray of uint8, shape (n,d)
        128 values with Euclidean distance (RootSift, Sift) or 32 bytes with Hamming distance (Orb).
    valid : ndarray of bool, shape (n)
        False if a point is too close to the image border.
    """

    descriptors: NDArray[np.uint8]
    valid: NDArray[np.bool_]


class FeaturesDescription2DInterface(Dfn[ConfigT, FeaturesDescription2DInputs, FeaturesDescription2DOutputs]):
    """Compute a descriptor of the image around each point; descriptors of the same point in two images
    are similar.
    """


#: Short names for the implementations.
Inputs = FeaturesDescription2DInputs
Outputs = FeaturesDescription2DOutputs
Interface = FeaturesDescription2DInterface

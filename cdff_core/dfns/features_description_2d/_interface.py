# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesDescription2D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class FeaturesDescription2DInputs:
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of uint8, shape (r,c)
        Grey image.
    features : ndarray of float64, shape (n,2)
        Column and row of each point, pixels.
    sizes : ndarray of float64, shape (n), optional
        Diameter of each point, pixels; one for all where absent.
    angles : ndarray of float64, shape (n), optional
        Direction of each point, degrees clockwise from x; from the grey values around it where absent.
    """

    image: NDArray[np.uint8]
    features: NDArray[np.float64]
    sizes: NDArray[np.float64] | None = None
    angles: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FeaturesDescription2DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    descriptors : ndarray of uint8, shape (n,d)
        128 numbers of Euclidean distance (RootSift, Sift), 32 bytes of Hamming distance (Orb).
    valid : ndarray of bool, shape (n)
        False where a point is too near to the rim to be described.
    """

    descriptors: NDArray[np.uint8]
    valid: NDArray[np.bool_]


class FeaturesDescription2DInterface(Dfn[Any, FeaturesDescription2DInputs, FeaturesDescription2DOutputs]):
    """Describe the image around each point so that the same point of another image has nearly the same description."""

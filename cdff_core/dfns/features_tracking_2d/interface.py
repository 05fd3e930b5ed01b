# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesTracking2D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesTracking2DInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    reference : ndarray of uint8, shape (r,c)
        Grey image that contains the points.
    image : ndarray of uint8, shape (r,c)
        Grey image in which the points are tracked.
    features : ndarray of float64, shape (n,2)
        Points of the reference, column and row, pixels.
    guess : ndarray of float64, shape (n,2), optional
        Initial positions in the image, pixels; default: the positions in the reference.
    warps : ndarray of float64, shape (n,3,3), optional
        Expected homographies from offsets around each point to offsets in the image; default: the identity.
    """

    ARRAYS = ArrayPorts(
        {
            "reference": "uint8[r,c]",
            "image": "uint8[r,c]",
            "features": "float64[n,2]",
            "guess": "float64[n,2]",
            "warps": "float64[n,3,3]",
        },
        optional=["guess", "warps"],
    )

    reference: NDArray[np.uint8]
    image: NDArray[np.uint8]
    features: NDArray[np.float64]
    guess: NDArray[np.float64] | None = None
    warps: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesTracking2DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    matches : ndarray of float64, shape (n,2)
        Position of each point, pixels; undefined if not valid.
    valid : ndarray of bool, shape (n)
        True for points that were tracked and confirmed by backward tracking.
    scores : ndarray of float64, shape (n)
        Normalised cross-correlation of the patches, -1 if not tracked.
    """

    matches: NDArray[np.float64]
    valid: NDArray[np.bool_]
    scores: NDArray[np.float64]


class FeaturesTracking2DInterface(Dfn[ConfigT, FeaturesTracking2DInputs, FeaturesTracking2DOutputs]):
    """Track points of one image in another image of the same camera with sub-pixel accuracy, and
    verify the result by tracking the points back.
    """


#: Short names for the implementations.
Inputs = FeaturesTracking2DInputs
Outputs = FeaturesTracking2DOutputs
Interface = FeaturesTracking2DInterface

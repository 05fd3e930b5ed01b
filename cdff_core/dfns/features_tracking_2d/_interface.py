# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesTracking2D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class FeaturesTracking2DInputs:
    """Inputs of one call.

    Attributes
    ----------
    reference : ndarray of uint8, shape (r,c)
        Grey image in which the points are known.
    image : ndarray of uint8, shape (r,c)
        Grey image in which they are sought.
    features : ndarray of float64, shape (n,2)
        Points of the reference, column and row, pixels.
    guess : ndarray of float64, shape (n,2), optional
        Where to begin in the image, pixels; the same place where absent.
    warps : ndarray of float64, shape (n,3,3), optional
        Expected homographies from offsets around each point to offsets in the image, the identity where absent.
    """

    reference: NDArray[np.uint8]
    image: NDArray[np.uint8]
    features: NDArray[np.float64]
    guess: NDArray[np.float64] | None = None
    warps: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FeaturesTracking2DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    matches : ndarray of float64, shape (n,2)
        Where each point was found, pixels; meaningless where not valid.
    valid : ndarray of bool, shape (n)
        Found and confirmed on the way back.
    scores : ndarray of float64, shape (n)
        Normalised cross-correlation of the patches, -1 where not found.
    """

    matches: NDArray[np.float64]
    valid: NDArray[np.bool_]
    scores: NDArray[np.float64]


class FeaturesTracking2DInterface(Dfn[Any, FeaturesTracking2DInputs, FeaturesTracking2DOutputs]):
    """Find points of one image in another of the same camera, to a fraction of a pixel, and check each by tracking
    it back.
    """

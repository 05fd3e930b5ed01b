# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesMatching2D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class FeaturesMatching2DInputs:
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of uint8, shape (n,d)
        Descriptors of the first image.
    sink : ndarray of uint8, shape (m,d)
        Descriptors of the second image, of the same kind.
    source_features : ndarray of float64, shape (n,2), optional
        Points of the first image, pixels; for a search along epipolar lines.
    sink_features : ndarray of float64, shape (m,2), optional
        Points of the second image.
    fundamental_matrix : ndarray of float64, shape (3,3), optional
        Sink' F source = 0 for what belongs together.
    """

    source: NDArray[np.uint8]
    sink: NDArray[np.uint8]
    source_features: NDArray[np.float64] | None = None
    sink_features: NDArray[np.float64] | None = None
    fundamental_matrix: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FeaturesMatching2DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    matches : ndarray of int64, shape (k,2)
        Rows of source and sink, the least ambiguous first.
    distances : ndarray of float64, shape (k)
        Distance of the descriptors.
    ratios : ndarray of float64, shape (k)
        That distance over the one to the second nearest: 0 unique, 1 ambiguous.
    """

    matches: NDArray[np.int64]
    distances: NDArray[np.float64]
    ratios: NDArray[np.float64]


class FeaturesMatching2DInterface(Dfn[Any, FeaturesMatching2DInputs, FeaturesMatching2DOutputs]):
    """Pair the points of two images whose descriptors are nearest to each other, on request only along their
    epipolar lines.
    """

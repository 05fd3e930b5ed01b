# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesMatching2D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesMatching2DInputs(DfnInputs):
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
        Points of the second image, pixels.
    fundamental_matrix : ndarray of float64, shape (3,3), optional
        Sink' F source = 0 for corresponding points.
    """

    ARRAYS = ArrayPorts(
        {
            "source": "uint8[n,d]",
            "sink": "uint8[m,d]",
            "source_features": "float64[n,2]",
            "sink_features": "float64[m,2]",
            "fundamental_matrix": "float64[3,3]",
        },
        optional=["source_features", "sink_features", "fundamental_matrix"],
    )

    source: NDArray[np.uint8]
    sink: NDArray[np.uint8]
    source_features: NDArray[np.float64] | None = None
    sink_features: NDArray[np.float64] | None = None
    fundamental_matrix: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesMatching2DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    matches : ndarray of int64, shape (k,2)
        Rows of source and sink, the least ambiguous first.
    distances : ndarray of float64, shape (k)
        Distance of the descriptors.
    ratios : ndarray of float64, shape (k)
        Ratio of the distance to that of the second nearest: 0 unique, 1 ambiguous.
    """

    matches: NDArray[np.int64]
    distances: NDArray[np.float64]
    ratios: NDArray[np.float64]


class FeaturesMatching2DInterface(Dfn[ConfigT, FeaturesMatching2DInputs, FeaturesMatching2DOutputs]):
    """Match the points of two images by their nearest descriptors, optionally only along their
    epipolar lines.
    """


#: Short names for the implementations.
Inputs = FeaturesMatching2DInputs
Outputs = FeaturesMatching2DOutputs
Interface = FeaturesMatching2DInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FeaturesExtraction2D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesExtraction2DInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of uint8, shape (r,c)
        Grey image.
    mask : ndarray of bool, shape (r,c), optional
        True for pixels at which points may be detected, False for example for pixels that show the robot;
        default: True for all pixels.
    """

    ARRAYS = ArrayPorts({"image": "uint8[r,c]", "mask": "bool[r,c]"}, optional=["mask"])

    image: NDArray[np.uint8]
    mask: NDArray[np.bool_] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FeaturesExtraction2DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    features : ndarray of float64, shape (n,2)
        Column and row of each point, pixels; GridGftt and GridFast order them by cell, the best first.
    scores : ndarray of float64, shape (n)
        Strength of each point, higher is better. GridGftt: smaller eigenvalue of the mean gradient matrix,
        (DN/px)^2; GridFast and AdaptiveFast: corner score, DN; Sift: contrast; Orb: Harris response.
    sizes : ndarray of float64, shape (n), optional
        Diameter of each point, pixels; absent for corner detectors with a fixed size.
    angles : ndarray of float64, shape (n), optional
        Direction of each point, degrees clockwise from x; absent for corner detectors with a fixed size.
    """

    features: NDArray[np.float64]
    scores: NDArray[np.float64]
    sizes: NDArray[np.float64] | None = None
    angles: NDArray[np.float64] | None = None


class FeaturesExtraction2DInterface(Dfn[ConfigT, FeaturesExtraction2DInputs, FeaturesExtraction2DOutputs]):
    """Find points that can be localised in both image directions, distributed over the whole image."""


#: Short names for the implementations.
Inputs = FeaturesExtraction2DInputs
Outputs = FeaturesExtraction2DOutputs
Interface = FeaturesExtraction2DInterface

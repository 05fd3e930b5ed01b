# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN AppearanceTracking."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AppearanceTrackingInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of uint8, shape (r,c)
        Grey image.
    template : ndarray of float32, shape (h,w)
        Grey levels of the object and of the pixels along its edge.
    weights : ndarray of float32, shape (h,w)
        Weights of the pixels of the template, 0 outside the object.
    place : ndarray of float64, shape (2)
        Expected column and row of the middle of the template.
    reach : ndarray of float64, shape (2)
        Largest distance from the expected position along columns and rows, pixels.
    scales : ndarray of float64, shape (s)
        Sizes of the object relative to the template, the expected size first.
    noise : float
        Standard deviation of the noise of a pixel, grey levels.
    """

    ARRAYS = ArrayPorts(
        {
            "image": "uint8[r,c]",
            "template": "float32[h,w]",
            "weights": "float32[h,w]",
            "place": "float64[2]",
            "reach": "float64[2]",
            "scales": "float64[s]",
        },
        finite=["template", "weights", "place"],
        positive=["reach", "scales", "noise"],
    )

    image: NDArray[np.uint8]
    template: NDArray[np.float32]
    weights: NDArray[np.float32]
    place: NDArray[np.float64]
    reach: NDArray[np.float64]
    scales: NDArray[np.float64]
    noise: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AppearanceTrackingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    place : ndarray of float64, shape (2)
        Column and row of the middle of the template; NaN outside the image.
    covariance : ndarray of float64, shape (2,2)
        Covariance of the position, square pixels.
    scale : float
        Size relative to the template.
    score : float
        Normalised correlation, -1 to 1; -1 outside the image.
    second : float
        Largest correlation at any other position of the search window.
    """

    place: NDArray[np.float64]
    covariance: NDArray[np.float64]
    scale: float
    score: float
    second: float


class AppearanceTrackingInterface(Dfn[ConfigT, AppearanceTrackingInputs, AppearanceTrackingOutputs]):
    """Find the image position (with covariance) and the scale at which an image shows the known
    appearance of an object, near its expected position.
    """


#: Short names for the implementations.
Inputs = AppearanceTrackingInputs
Outputs = AppearanceTrackingOutputs
Interface = AppearanceTrackingInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN MovingRegionDetection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MovingRegionDetectionInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    image : ndarray of uint8, shape (r,c)
        Grey image.
    places : ndarray of float32, shape (r,c,2), optional
        Column and row of each pixel in the previous image; if absent, the background starts with this
        image.
    sigma : ndarray of float32, shape (r,c), optional
        Standard deviation of these positions, pixels; default: 0.05.
    is_at_rest : bool
        True if no pixel has moved since the previous image.
    excluded : ndarray of bool, shape (r,c), optional
        Pixels of known objects, with which the background is not updated.
    departed : ndarray of bool, shape (r,c), optional
        Pixels of objects that have left their first positions: not replaced.
    replaced : ndarray of bool, shape (r,c), optional
        Pixels of objects at rest, at which the background is replaced by the image at once.
    """

    ARRAYS = ArrayPorts(
        {
            "image": "uint8[r,c]",
            "places": "float32[r,c,2]",
            "sigma": "float32[r,c]",
            "excluded": "bool[r,c]",
            "departed": "bool[r,c]",
            "replaced": "bool[r,c]",
        },
        optional=["places", "sigma", "excluded", "departed", "replaced"],
    )

    image: NDArray[np.uint8]
    is_at_rest: bool
    places: NDArray[np.float32] | None = None
    sigma: NDArray[np.float32] | None = None
    excluded: NDArray[np.bool_] | None = None
    departed: NDArray[np.bool_] | None = None
    replaced: NDArray[np.bool_] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MovingRegionDetectionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    boxes : ndarray of float64, shape (n,4)
        First and last column, first and last row of each region, with sub-pixel accuracy.
    centroids : ndarray of float64, shape (n,2)
        Column and row of the centre of the area of each region.
    covariances : ndarray of float64, shape (n,2,2)
        Covariances of the centroids, square pixels.
    areas : ndarray of float64, shape (n)
        Areas, square pixels.
    significances : ndarray of float64, shape (n)
        Largest difference from the background in standard deviations.
    sharpness : ndarray of float64, shape (n)
        Largest gradient of the difference, divided by the largest difference, 1/pixel; small for dust and
        shadows of clouds.
    labels : ndarray of int32, shape (r,c)
        Number of the region of each pixel, from 1; 0 outside.
    noise : float
        Standard deviation of the noise of a pixel of mean brightness, grey levels.
    """

    boxes: NDArray[np.float64]
    centroids: NDArray[np.float64]
    covariances: NDArray[np.float64]
    areas: NDArray[np.float64]
    significances: NDArray[np.float64]
    sharpness: NDArray[np.float64]
    labels: NDArray[np.int32]
    noise: float


class MovingRegionDetectionInterface(Dfn[ConfigT, MovingRegionDetectionInputs, MovingRegionDetectionOutputs]):
    """Detect the regions of an image that differ from the background of the previous images, which is
    warped by the registration of the scene.
    """


#: Short names for the implementations.
Inputs = MovingRegionDetectionInputs
Outputs = MovingRegionDetectionOutputs
Interface = MovingRegionDetectionInterface

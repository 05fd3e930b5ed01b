# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PointSourceDetection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointSourceDetectionInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    residual : ndarray of float32, shape (r,c)
        Image without its background, DN.
    noise : ndarray of float32, shape (r,c)
        Standard deviation of the noise of each pixel, DN.
    mask : ndarray of uint8, shape (r,c)
        0 usable, 1 saturated, 2 trail.
    point_spread : ndarray of float64, shape (2,2)
        Covariance of the point spread function, square pixels.
    """

    ARRAYS = ArrayPorts(
        {
            "residual": "float32[r,c]",
            "noise": "float32[r,c]",
            "mask": "uint8[r,c]",
            "point_spread": "float64[2,2]",
        },
        finite=["point_spread"],
    )

    residual: NDArray[np.float32]
    noise: NDArray[np.float32]
    mask: NDArray[np.uint8]
    point_spread: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointSourceDetectionOutputs:
    """Outputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,2)
        Column and row of each source, pixels, brightest first: the maximum, or the centroid of an extended
        source.
    snr : ndarray of float64, shape (n)
        Ratio of the filtered signal to its noise.
    areas : ndarray of int64, shape (n)
        Number of connected pixels above the noise; 0 below the limit of bright sources.
    boxes : ndarray of float64, shape (n,4)
        First and last column, first and last row of these pixels.
    moments : ndarray of float64, shape (n,3)
        Second moments uu, uv, vv of the light of these pixels, square pixels.
    is_extended : ndarray of bool, shape (n)
        True for a source that is larger than the image of a point of its brightness.
    is_trail : ndarray of bool, shape (n)
        True for a source on a trail.
    """

    points: NDArray[np.float64]
    snr: NDArray[np.float64]
    areas: NDArray[np.int64]
    boxes: NDArray[np.float64]
    moments: NDArray[np.float64]
    is_extended: NDArray[np.bool_]
    is_trail: NDArray[np.bool_]


class PointSourceDetectionInterface(Dfn[ConfigT, PointSourceDetectionInputs, PointSourceDetectionOutputs]):
    """Find sources in an image without background, and measure the extent of those that are larger
    than a point.
    """


#: Short names for the implementations.
Inputs = PointSourceDetectionInputs
Outputs = PointSourceDetectionOutputs
Interface = PointSourceDetectionInterface

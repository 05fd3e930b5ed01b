# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PointSourceCentroiding."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointSourceCentroidingInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    residual : ndarray of float32, shape (r,c)
        Image without its background, DN.
    noise : ndarray of float32, shape (r,c)
        Standard deviation of the noise of each pixel, DN.
    points : ndarray of float64, shape (n,2)
        Approximate column and row of each source, pixels.
    point_spread : ndarray of float64, shape (2,2)
        Covariance of the point spread function, square pixels.
    """

    ARRAYS = ArrayPorts(
        {
            "residual": "float32[r,c]",
            "noise": "float32[r,c]",
            "points": "float64[n,2]",
            "point_spread": "float64[2,2]",
        },
        finite=["points", "point_spread"],
    )

    residual: NDArray[np.float32]
    noise: NDArray[np.float32]
    points: NDArray[np.float64]
    point_spread: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PointSourceCentroidingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    centroids : ndarray of float64, shape (n,2)
        Column and row, pixels; NaN where the fit failed.
    covariances : ndarray of float64, shape (n,2,2)
        Covariances of the centroids, square pixels.
    fluxes : ndarray of float64, shape (n)
        Light of each source, DN.
    snr : ndarray of float64, shape (n)
        Ratio of the light to its standard deviation in the noise of the background.
    misfit : ndarray of float64, shape (n)
        Mean squared residual of the fit, normalised by the noise.
    is_single_pixel : ndarray of bool, shape (n)
        True for a source whose light is in one pixel: a hot pixel or cosmic ray.
    defect_evidence : ndarray of float64, shape (n)
        Normalised squared residuals of the fit of a point source minus those of the fit of a single bright
        pixel; positive for a defect.
    spreads : ndarray of float64, shape (n,3)
        Fitted covariance uu, uv, vv of the light, square pixels; NaN for faint sources.
    """

    centroids: NDArray[np.float64]
    covariances: NDArray[np.float64]
    fluxes: NDArray[np.float64]
    snr: NDArray[np.float64]
    misfit: NDArray[np.float64]
    is_single_pixel: NDArray[np.bool_]
    defect_evidence: NDArray[np.float64]
    spreads: NDArray[np.float64]


class PointSourceCentroidingInterface(
    Dfn[ConfigT, PointSourceCentroidingInputs, PointSourceCentroidingOutputs]
):
    """Estimate the position (with covariance) and the brightness of point sources, and recognise hot
    pixels and cosmic rays by their light in a single pixel.
    """


#: Short names for the implementations.
Inputs = PointSourceCentroidingInputs
Outputs = PointSourceCentroidingOutputs
Interface = PointSourceCentroidingInterface

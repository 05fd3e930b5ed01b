# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN TrackAssociation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrackAssociationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    places : ndarray of float64, shape (m,2)
        Expected column and row of each object.
    covariances : ndarray of float64, shape (m,2,2)
        Covariances of these positions, square pixels.
    sizes : ndarray of float64, shape (m,2)
        Expected width and height of each object, pixels.
    size_sigmas : ndarray of float64, shape (m)
        Standard deviation of the logarithm of each size.
    regions : ndarray of float64, shape (n,2)
        Column and row of each region.
    region_covariances : ndarray of float64, shape (n,2,2)
        Covariances of the regions, square pixels.
    region_sizes : ndarray of float64, shape (n,2)
        Width and height of each region, pixels.
    similarities : ndarray of float64, shape (m,n), optional
        Correlation of the appearance of object and region, -1 to 1; NaN where not compared.
    """

    ARRAYS = ArrayPorts(
        {
            "places": "float64[m,2]",
            "covariances": "float64[m,2,2]",
            "sizes": "float64[m,2]",
            "size_sigmas": "float64[m]",
            "regions": "float64[n,2]",
            "region_covariances": "float64[n,2,2]",
            "region_sizes": "float64[n,2]",
            "similarities": "float64[m,n]",
        },
        finite=["places", "covariances", "regions", "region_covariances"],
        positive=["sizes", "size_sigmas", "region_sizes"],
        optional=["similarities"],
    )

    places: NDArray[np.float64]
    covariances: NDArray[np.float64]
    sizes: NDArray[np.float64]
    size_sigmas: NDArray[np.float64]
    regions: NDArray[np.float64]
    region_covariances: NDArray[np.float64]
    region_sizes: NDArray[np.float64]
    similarities: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrackAssociationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    chosen : ndarray of int64, shape (m)
        Region of each object; -1 for none.
    costs : ndarray of float64, shape (m)
        Squared normalised difference between object and region; NaN for objects without a region.
    is_ambiguous : ndarray of bool, shape (m)
        True if another object or another region fits nearly as well.
    """

    chosen: NDArray[np.int64]
    costs: NDArray[np.float64]
    is_ambiguous: NDArray[np.bool_]


class TrackAssociationInterface(Dfn[ConfigT, TrackAssociationInputs, TrackAssociationOutputs]):
    """Associate the regions of an image with tracked objects by position, size and appearance, jointly
    for all objects.
    """


#: Short names for the implementations.
Inputs = TrackAssociationInputs
Outputs = TrackAssociationOutputs
Interface = TrackAssociationInterface

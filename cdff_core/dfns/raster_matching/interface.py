# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN RasterMatching."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import ElevationMap


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RasterMatchingInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    reference : ElevationMap
        Map that is searched, layer mean; heights are compared at its cell size, or at that of the template
        if the cells of the template are larger.
    template : ElevationMap
        Map to locate, layer mean.
    guess : ndarray of float64, shape (4,4), optional
        T_reference_template, centre of the search; default: the identity.
    reach : ndarray of float64, shape (2), optional
        Largest distance from the guess at the template's middle, metres and radians; default: the
        configured value.
    """

    ARRAYS = ArrayPorts({"guess": "float64[4,4]", "reach": "float64[2]"}, optional=["guess", "reach"])

    reference: ElevationMap
    template: ElevationMap
    guess: NDArray[np.float64] | None = None
    reach: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RasterMatchingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transforms : ndarray of float64, shape (k,4,4)
        T_reference_template of the candidates, best first: horizontal translation, rotation about z, and
        height.
    covariances : ndarray of float64, shape (k,4,4)
        Covariance of x, y, z and yaw at the template's middle, errors in the reference's frame, square
        metres and radians.
    correlations : ndarray of float64, shape (k)
        Correlation of the gradients over the cells that both maps observe.
    explained : ndarray of float64, shape (k)
        Fraction of the template's relief (deviation from its mean plane) that the reference explains;
        negative if the reference increases the variance.
    log_likelihoods : ndarray of float64, shape (k)
        Log-likelihood ratio of each candidate to a plane with noise.
    centre : ndarray of float64, shape (3)
        Middle of the template, in its own frame, metres.
    """

    transforms: NDArray[np.float64]
    covariances: NDArray[np.float64]
    correlations: NDArray[np.float64]
    explained: NDArray[np.float64]
    log_likelihoods: NDArray[np.float64]
    centre: NDArray[np.float64]


class RasterMatchingInterface(Dfn[ConfigT, RasterMatchingInputs, RasterMatchingOutputs]):
    """Locate an elevation map on a coarser elevation map by the shape of the relief, and return
    candidates with covariance and likelihood.
    """


#: Short names for the implementations.
Inputs = RasterMatchingInputs
Outputs = RasterMatchingOutputs
Interface = RasterMatchingInterface

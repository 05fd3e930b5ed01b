# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN RasterMatching."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import ElevationMap


@dataclass(frozen=True, slots=True, eq=False)
class RasterMatchingInputs:
    """Inputs of one call.

    Attributes
    ----------
    reference : ElevationMap
        Map that is searched, layer mean; its cells are those of the comparison.
    template : ElevationMap
        Map that is looked for, layer mean; cells at most as large as the reference's.
    guess : ndarray of float64, shape (4,4), optional
        T_reference_template about which is searched; the identity where absent.
    reach : ndarray of float64, shape (2), optional
        How far from the guess is searched at the template's middle, metres and radians; as configured where absent.
    """

    reference: ElevationMap
    template: ElevationMap
    guess: NDArray[np.float64] | None = None
    reach: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class RasterMatchingOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transforms : ndarray of float64, shape (k,4,4)
        T_reference_template of the candidates, best first: a shift, a turn about z, a height.
    covariances : ndarray of float64, shape (k,4,4)
        Of x, y, z and yaw at the template's middle, errors in the reference's frame, square metres and radians.
    correlations : ndarray of float64, shape (k)
        Of the gradients where both maps are observed.
    explained : ndarray of float64, shape (k)
        Share of the template's relief, about its plane, that the reference explains; below 0 where it makes it
        worse.
    log_likelihoods : ndarray of float64, shape (k)
        Of each candidate, against the template being a plane with noise.
    centre : ndarray of float64, shape (3)
        Middle of the template, in its own frame, metres.
    """

    transforms: NDArray[np.float64]
    covariances: NDArray[np.float64]
    correlations: NDArray[np.float64]
    explained: NDArray[np.float64]
    log_likelihoods: NDArray[np.float64]
    centre: NDArray[np.float64]


class RasterMatchingInterface(Dfn[Any, RasterMatchingInputs, RasterMatchingOutputs]):
    """Where an elevation map lies on a coarser one of the same ground, by the shape of the relief: candidates with
    covariance, and how far the best stands out.
    """

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN PoseEstimation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimationInputs:
    """Inputs of one call.

    Attributes
    ----------
    prediction : ndarray of float64, shape (4,4)
        T_map_body as predicted.
    prediction_covariance : ndarray of float64, shape (6,6)
        Of it: x y z rx ry rz, perturbation in the map's frame.
    measurement : ndarray of float64, shape (4,4)
        T_map_body as measured.
    measurement_covariance : ndarray of float64, shape (6,6)
        Of it, likewise.
    """

    prediction: NDArray[np.float64]
    prediction_covariance: NDArray[np.float64]
    measurement: NDArray[np.float64]
    measurement_covariance: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    pose : ndarray of float64, shape (4,4)
        T_map_body.
    covariance : ndarray of float64, shape (6,6)
        Of it: along each direction the smaller one of both.
    innovation : ndarray of float64, shape ()
        Squared difference of both by the sum of their covariances; 6 expected.
    measured_directions : ndarray of int64, shape ()
        Directions of six along which the measurement was the better one.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]
    innovation: NDArray[np.float64]
    measured_directions: NDArray[np.int64]


class PoseEstimationInterface(Dfn[Any, PoseEstimationInputs, PoseEstimationOutputs]):
    """Join a predicted pose with a measured one, each with its covariance, or refuse the measurement where the two
    cannot both be right.
    """

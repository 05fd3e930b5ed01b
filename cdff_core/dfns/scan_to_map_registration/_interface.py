# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ScanToMapRegistration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class ScanToMapRegistrationInputs:
    """Inputs of one call.

    Attributes
    ----------
    surface : ndarray of float64, shape (k,3), optional
        Points in the frame of the map, added to it before all else, metres.
    points : ndarray of float64, shape (n,3), optional
        Points of the sweep, each in the sensor's frame at its own time, metres; without any the map just grows.
    fraction : ndarray of float64, shape (n), optional
        When each point was measured: -1 at the begin, 0 at the end of the sweep; absent where all were at once.
    guess : ndarray of float64, shape (4,4), optional
        T_map_sensor at the end of the sweep, to begin from.
    sweep_guess : ndarray of float64, shape (4,4), optional
        T_end_begin, motion during the sweep, to begin from; identity where absent.
    guess_covariance : ndarray of float64, shape (6,6), optional
        Of the guess: x y z rx ry rz, error in the frame of the map.
    sweep_covariance : ndarray of float64, shape (6,6), optional
        Of the sweep's motion: x y z rx ry rz.
    before : ndarray of float64, shape (4,4), optional
        T_map_sensor at the end of the sweep before; with sweepShare the sweep's motion is expected as that share of
        the motion since then, whatever that turns out to be, and sweepGuess is but the begin.
    sweep_share : ndarray of float64, shape (), optional
        Length of the sweep by the time since the end of the sweep before.
    """

    surface: NDArray[np.float64] | None = None
    points: NDArray[np.float64] | None = None
    fraction: NDArray[np.float64] | None = None
    guess: NDArray[np.float64] | None = None
    sweep_guess: NDArray[np.float64] | None = None
    guess_covariance: NDArray[np.float64] | None = None
    sweep_covariance: NDArray[np.float64] | None = None
    before: NDArray[np.float64] | None = None
    sweep_share: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ScanToMapRegistrationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transform : ndarray of float64, shape (4,4)
        T_map_sensor at the end of the sweep.
    sweep : ndarray of float64, shape (4,4)
        T_end_begin, motion during the sweep.
    covariance : ndarray of float64, shape (6,6)
        Of transform: x y z rx ry rz, error in the frame of the map, guess included.
    directions : ndarray of float64, shape (6,6)
        Eigenvectors of the information as rows: shift of the sensor, and turn about it times radiusM, in axes of
        the map.
    agreement : ndarray of float64, shape (6)
        Share of the information along each direction that both halves of the map agree on, where its planes are
        known; near 0 where there is none but noise.
    sigma_m : ndarray of float64, shape (6)
        Standard deviation that the map alone leaves along each direction, metres.
    radius_m : ndarray of float64, shape ()
        Root mean square distance of the matched points, metres.
    inlier_ratio : ndarray of float64, shape ()
        Share of the sweep's thinned points that lie on the map.
    rms_m : ndarray of float64, shape ()
        Weighted root mean square distance to the planes, metres.
    iterations : ndarray of int64, shape ()
        Iterations done.
    converged : ndarray of bool, shape ()
        Whether the last step was below the tolerance.
    """

    transform: NDArray[np.float64]
    sweep: NDArray[np.float64]
    covariance: NDArray[np.float64]
    directions: NDArray[np.float64]
    agreement: NDArray[np.float64]
    sigma_m: NDArray[np.float64]
    radius_m: NDArray[np.float64]
    inlier_ratio: NDArray[np.float64]
    rms_m: NDArray[np.float64]
    iterations: NDArray[np.int64]
    converged: NDArray[np.bool_]


class ScanToMapRegistrationInterface(Dfn[Any, ScanToMapRegistrationInputs, ScanToMapRegistrationOutputs]):
    """Align the sweep of a lidar that moves while it turns with a map of what was seen before, pose and motion
    during the sweep at once, and say along which directions the map holds no information. The map is held by the
    node; it grows by the surfaces that it is given and forgets what is far.
    """

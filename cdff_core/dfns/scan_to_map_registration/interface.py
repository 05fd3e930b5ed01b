# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN ScanToMapRegistration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScanToMapRegistrationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    new_map_points : ndarray of float64, shape (k,3), optional
        Points in the frame of the map, metres; added to the map before the registration.
    points : ndarray of float64, shape (n,3), optional
        Points of the sweep, each in the sensor's frame at its own time, metres; without them the map is
        only extended.
    point_times : ndarray of float64, shape (n), optional
        Time of each point relative to the sweep: -1 at its start, 0 at its end; absent if all points have
        the same time.
    guess : ndarray of float64, shape (4,4), optional
        Initial T_map_sensor at the end of the sweep.
    sweep_guess : ndarray of float64, shape (4,4), optional
        Initial T_end_start, motion of the sensor during the sweep; default: identity.
    guess_covariance : ndarray of float64, shape (6,6), optional
        Covariance of the guess, [x y z rx ry rz], error in the frame of the map.
    sweep_covariance : ndarray of float64, shape (6,6), optional
        Covariance of the motion during the sweep, [x y z rx ry rz].
    previous_pose : ndarray of float64, shape (4,4), optional
        T_map_sensor at the end of the previous sweep. If both previousPose and sweepFraction are given, the
        prior of the motion during the sweep is sweepFraction times the motion since this pose, and
        sweepGuess is only the initial value.
    sweep_fraction : float, optional
        Ratio of the duration of the sweep to the time since the end of the previous sweep.
    alternative_guesses : ndarray of float64, shape (m,4,4), optional
        Further guesses of T_map_sensor, for a sweep that does not match at the guess. The guesses with the
        largest support, including guess, are registered, and the result with the largest supportRatio is
        returned.
    """

    ARRAYS = ArrayPorts(
        {
            "new_map_points": "float64[k,3]",
            "points": "float64[n,3]",
            "point_times": "float64[n]",
            "guess": "float64[4,4]",
            "sweep_guess": "float64[4,4]",
            "guess_covariance": "float64[6,6]",
            "sweep_covariance": "float64[6,6]",
            "previous_pose": "float64[4,4]",
            "alternative_guesses": "float64[m,4,4]",
        },
        finite=["guess_covariance", "sweep_covariance"],
        optional=[
            "new_map_points",
            "points",
            "point_times",
            "guess",
            "sweep_guess",
            "guess_covariance",
            "sweep_covariance",
            "previous_pose",
            "alternative_guesses",
        ],
    )

    new_map_points: NDArray[np.float64] | None = None
    points: NDArray[np.float64] | None = None
    point_times: NDArray[np.float64] | None = None
    guess: NDArray[np.float64] | None = None
    sweep_guess: NDArray[np.float64] | None = None
    guess_covariance: NDArray[np.float64] | None = None
    sweep_covariance: NDArray[np.float64] | None = None
    previous_pose: NDArray[np.float64] | None = None
    sweep_fraction: float | None = None
    alternative_guesses: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScanToMapRegistrationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transform : ndarray of float64, shape (4,4)
        T_map_sensor at the end of the sweep.
    sweep : ndarray of float64, shape (4,4)
        T_end_start, motion of the sensor during the sweep.
    covariance : ndarray of float64, shape (6,6)
        Covariance of transform, [x y z rx ry rz], error in the frame of the map; the information of the
        guess is included.
    residual_covariance : ndarray of float64, shape (6,6)
        Covariance of transform due to errors that all points on a plane have in common, estimated from
        their residuals (clustered sandwich).
    calibration_covariance : ndarray of float64, shape (6,6)
        Covariance of transform due to calibration errors of the lidar, which are the same in every sweep;
        not contained in covariance.
    directions : ndarray of float64, shape (6,6)
        Eigenvectors of the information as rows: translation of the sensor, then rotation about the sensor
        times radiusM, in the axes of the map.
    agreement : ndarray of float64, shape (6)
        Fraction of the information along each direction on which both halves of the map agree; near 0 for
        noise.
    sigma_m : ndarray of float64, shape (6)
        Standard deviation along each direction from the map alone, metres.
    gains : ndarray of float64, shape (6)
        Weight of the map along each direction, 1 if the direction is constrained; the weight of the guess
        is 1 minus this value.
    radius_m : float
        Root mean square distance of the matched points, metres.
    inlier_ratio : float
        Fraction of the downsampled points that lie on the map.
    support_ratio : float
        Mean weight of the robust kernel over the downsampled points, 0 for points without a plane; to
        compare registrations of the same sweep.
    rms_m : float
        Weighted root mean square distance to the planes, metres.
    iterations : int
        Number of iterations.
    converged : bool
        True if the last step was below the tolerance.
    """

    transform: NDArray[np.float64]
    sweep: NDArray[np.float64]
    covariance: NDArray[np.float64]
    residual_covariance: NDArray[np.float64]
    calibration_covariance: NDArray[np.float64]
    directions: NDArray[np.float64]
    agreement: NDArray[np.float64]
    sigma_m: NDArray[np.float64]
    gains: NDArray[np.float64]
    radius_m: float
    inlier_ratio: float
    support_ratio: float
    rms_m: float
    iterations: int
    converged: bool


class ScanToMapRegistrationInterface(Dfn[ConfigT, ScanToMapRegistrationInputs, ScanToMapRegistrationOutputs]):
    """Align the sweep of a moving lidar with a local map, estimate the pose together with the motion
    during the sweep, and identify the directions that the map does not constrain. The DFN stores
    the map: points are added, and distant regions are removed.
    """


#: Short names for the implementations.
Inputs = ScanToMapRegistrationInputs
Outputs = ScanToMapRegistrationOutputs
Interface = ScanToMapRegistrationInterface

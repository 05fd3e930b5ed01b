# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN BodyMotionEstimation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BodyMotionEstimationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    times_s : ndarray of float64, shape (n)
        Ascending times of the poses, s.
    poses : ndarray of float64, shape (n,4,4)
        T_reference_body; the reference frame does not rotate.
    covariances : ndarray of float64, shape (n,6,6)
        Covariances of the poses, [x y z rx ry rz], perturbation in the reference frame.
    is_noise_known : bool
        True if the covariances are known; False if only their ratios are known, so that their scale is
        estimated from the residuals.
    queries_s : ndarray of float64, shape (m)
        Times at which the motion is returned, at or after the last pose, s.
    is_fitted : bool
        True: predict with the previous fit; False, or before the first fit: fit the motion to the poses.
    """

    ARRAYS = ArrayPorts(
        {
            "times_s": "float64[n]",
            "poses": "float64[n,4,4]",
            "covariances": "float64[n,6,6]",
            "queries_s": "float64[m]",
        },
        finite=["times_s", "poses", "covariances", "queries_s"],
    )

    times_s: NDArray[np.float64]
    poses: NDArray[np.float64]
    covariances: NDArray[np.float64]
    is_noise_known: bool
    queries_s: NDArray[np.float64]
    is_fitted: bool


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BodyMotionEstimationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    poses : ndarray of float64, shape (m,4,4)
        T_reference_body at the queries.
    covariances : ndarray of float64, shape (m,6,6)
        Covariances of these poses.
    velocities : ndarray of float64, shape (m,6)
        Velocity of the body's origin and angular rate, reference frame, m/s and rad/s.
    velocity_covariances : ndarray of float64, shape (m,6,6)
        Covariances of the velocities.
    axis : ndarray of float64, shape (3), optional
        Unit vector along the angular momentum, reference frame; absent if no rotation is found.
    axis_sigma_rad : float
        Largest standard deviation of the direction of the axis, rad.
    rate_rad_s : float
        Mean angular rate about the axis, rad/s.
    rate_sigma_rad_s : float
        Standard deviation of the rate, rad/s.
    moment_ratios : ndarray of float64, shape (2), optional
        Smallest and middle moment of inertia, divided by the largest; absent if unobservable.
    moment_ratios_covariance : ndarray of float64, shape (2,2), optional
        Covariance of these ratios.
    principal_axes : ndarray of float64, shape (3,3), optional
        Principal axes in the body frame as columns, ascending moments; absent if unobservable.
    is_tumbling : bool
        True if the poses contradict a rotation about one axis.
    may_tumble : bool
        True for a rotation about one axis if the poses are too few, or cover too small a rotation, to
        distinguish a tumble: predictions may be wrong.
    centre_m : ndarray of float64, shape (3)
        Centre of mass in the body frame, m.
    centre_covariance : ndarray of float64, shape (3,3)
        Covariance of the centre, m^2.
    unobservable : ndarray of float64, shape (k,3)
        Unit vectors in the body frame along which the centre is not determined.
    outliers : int
        Number of poses that contradict the motion.
    noise_factor : float
        Ratio of the estimated to the stated variance of the orientations; at least 1 for known noise.
    increment_rad : float
        Median rotation between consecutive poses, rad; above 2.6 the sense of rotation is ambiguous.
    """

    poses: NDArray[np.float64]
    covariances: NDArray[np.float64]
    velocities: NDArray[np.float64]
    velocity_covariances: NDArray[np.float64]
    axis_sigma_rad: float
    rate_rad_s: float
    rate_sigma_rad_s: float
    is_tumbling: bool
    may_tumble: bool
    centre_m: NDArray[np.float64]
    centre_covariance: NDArray[np.float64]
    unobservable: NDArray[np.float64]
    outliers: int
    noise_factor: float
    increment_rad: float
    axis: NDArray[np.float64] | None = None
    moment_ratios: NDArray[np.float64] | None = None
    moment_ratios_covariance: NDArray[np.float64] | None = None
    principal_axes: NDArray[np.float64] | None = None


class BodyMotionEstimationInterface(Dfn[ConfigT, BodyMotionEstimationInputs, BodyMotionEstimationOutputs]):
    """Estimate the motion of a force-free rigid body from its poses (rotation, position and motion of
    the centre of mass, and ratios of the moments of inertia if the motion determines them), and
    predict its poses.
    """


#: Short names for the implementations.
Inputs = BodyMotionEstimationInputs
Outputs = BodyMotionEstimationOutputs
Interface = BodyMotionEstimationInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prior information of a registration: guesses of the pose and of the motion during the sweep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error, rotation_blocks
from cdff_common.geometry.points import checked_transform
from cdff_core.dfns.scan_to_map_registration.interface import Inputs

#: Information on the motion during the sweep if its covariance is not given: fixed at its initial value.
_FIXED_MOTION_INFORMATION = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class Prior:
    """Normal distribution of the pose and of the motion during the sweep.

    Attributes
    ----------
    T_guess : ndarray, shape (4, 4)
        T_map_sensor at the end of the sweep.
    motion_guess : ndarray, shape (6,)
        Translation and rotation during the sweep, in axes of the sensor.
    pose_covariance : ndarray, shape (6, 6)
        Zeros if not given.
    pose_information, motion_information : ndarray, shape (6, 6)
        Inverse covariances; zeros for a pose without a covariance.
    T_previous : ndarray, shape (4, 4), or None
        T_map_sensor at the end of the previous sweep; if given, the expected motion during the sweep is
        ``sweep_fraction`` times the motion since this pose.
    sweep_fraction : float
    """

    T_guess: FloatArray
    motion_guess: FloatArray
    pose_covariance: FloatArray
    pose_information: FloatArray
    motion_information: FloatArray
    T_previous: FloatArray | None
    sweep_fraction: float

    @classmethod
    def from_inputs(cls, inputs: Inputs, T_guess: FloatArray, motion_guess: FloatArray) -> Prior:
        """Return the prior with the covariances and the previous pose of the inputs."""
        motion_information = information(inputs.sweep_covariance)
        motion_information += _FIXED_MOTION_INFORMATION * np.eye(6) * (inputs.sweep_covariance is None)
        return cls(
            T_guess,
            motion_guess,
            np.zeros((6, 6)) if inputs.guess_covariance is None else inputs.guess_covariance,
            information(inputs.guess_covariance),
            motion_information,
            *previous_pose(inputs.previous_pose, inputs.sweep_fraction),
        )

    def add_to(self, A: FloatArray, g: FloatArray, T_map_sensor: FloatArray, motion: FloatArray) -> None:
        """Add information and gradient at an estimate to the normal equations (12, 12) and (12,)."""
        A[:6, :6] += self.pose_information
        g[:6] += self.pose_information @ pose_error(T_map_sensor, self.T_guess)
        expected, J = (
            (self.motion_guess, np.zeros((6, 6)))
            if self.T_previous is None
            else fraction_of_motion(self.T_previous, T_map_sensor, self.sweep_fraction)
        )
        J_prior = np.hstack([-J, np.eye(6)])
        A += J_prior.T @ self.motion_information @ J_prior
        g += J_prior.T @ self.motion_information @ (motion - expected)


def information(covariance: FloatArray | None) -> FloatArray:
    """Return the inverse of a covariance (6, 6); zeros without one."""
    return np.zeros((6, 6)) if covariance is None else np.asarray(np.linalg.inv(covariance), np.float64)


def previous_pose(T_previous: FloatArray | None, fraction: float | None) -> tuple[FloatArray | None, float]:
    """Return the previous pose, None if not given, and the fraction of the motion since then that happens
    during the sweep.
    """
    if T_previous is None or fraction is None:
        return None, 0.0
    if not 0.0 <= fraction <= 1.0:
        raise InputError(f"sweep_fraction {fraction:g}: expected 0 to 1, since sweeps do not overlap in time")
    return checked_transform(T_previous, "previous_pose"), fraction


def fraction_of_motion(
    T_map_previous: FloatArray, T_map_sensor: FloatArray, fraction: float
) -> tuple[FloatArray, FloatArray]:
    """Return a fraction (6,) of the motion from the previous to the current pose, in sensor axes, and its
    derivative (6, 6) with respect to a change of ``T_map_sensor`` in map axes.
    """
    R = T_map_sensor[:3, :3]
    J = fraction * rotation_blocks(R.T)
    rotation = se3.log_so3(T_map_previous[:3, :3].T @ R)
    return fraction * np.concatenate([R.T @ (T_map_sensor[:3, 3] - T_map_previous[:3, 3]), rotation]), J


@dataclass(frozen=True, slots=True, eq=False)
class Fusion:
    """Pose with the guess as a measurement along weakly constrained directions."""

    T: FloatArray  # (4, 4)
    covariance: FloatArray  # (6, 6)
    gains: FloatArray  # (k,), weight of the registration along each of the directions


def fuse_with_guess(
    prior: Prior,
    T_map_sensor: FloatArray,
    covariance: FloatArray,
    directions: FloatArray,
    sigma_m: FloatArray,
    radius_m: float,
) -> Fusion:
    """Fuse a registered pose with its guess along degenerate directions (k, 6).

    ``sigma_m`` (k,) are the standard deviations along these directions from the map alone.

    Along a direction without information on which both halves of the map agree, ``sigma_m`` is large, and the
    guess remains (solution remapping, Zhang et al. 2016, doi:10.1109/ICRA.2016.7487211). Otherwise both are
    weighted by their variances, as by a Kalman filter.
    """
    scale = np.concatenate([np.ones(3), np.full(3, radius_m)])
    P = prior.pose_covariance * np.outer(scale, scale)
    variance = np.einsum("ki,ij,kj->k", directions, P, directions)
    gains = variance / (variance + sigma_m**2)
    constrained = np.eye(6) - directions.T @ directions
    by_guess = (directions.T * (1.0 - gains)) @ directions
    correction = (np.eye(6) - by_guess) @ (scale * pose_error(T_map_sensor, prior.T_guess))
    R = se3.normalise_rotation(se3.exp_so3(correction[3:] / radius_m) @ prior.T_guess[:3, :3])
    mixed = constrained @ (covariance * np.outer(scale, scale)) @ constrained + by_guess @ P @ by_guess
    mixed += (directions.T * (gains * sigma_m) ** 2) @ directions
    return Fusion(
        se3.transform(R, prior.T_guess[:3, 3] + correction[:3]), mixed / np.outer(scale, scale), gains
    )

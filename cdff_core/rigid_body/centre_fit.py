# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fit of the centre of mass of a rotating body, and of its path, to measured positions of a point of the
body.

The point is at ``centre(t) - R(t) offset``, with the constant position ``offset`` of the centre in the
body. The velocity of the centre is a random walk, whose intensity follows from the positions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.geometry import se3
from cdff_core.rigid_body.drifting_fit import DriftingFit, DriftingProblem

#: Squared normalised innovation above which a position is an outlier, factor on the covariance of an
#: outlier, and largest number of rounds in which outliers are determined again.
_OUTLIER, _EXCLUDED, _MAX_ROUNDS = 25.0, 1e8, 5
#: Ratio of the standard deviation of a component of the offset to its prior standard deviation above which
#: the component is unobservable.
_UNOBSERVABLE = 0.5


@dataclass(frozen=True, slots=True)
class CentreFit:
    """Centre of mass of a body and its path.

    Attributes
    ----------
    fit : DriftingFit
        Parameters: the position of the centre in the body, m; drift: position and velocity of the centre at
        the last measurement.
    last_s : float
    inliers : ndarray of bool (n,)
    unobservable : ndarray (m, 3)
        Unit vectors in body axes along which the offset is not determined, 0 to 3 of them.
    """

    fit: DriftingFit
    last_s: float
    inliers: BoolArray
    unobservable: FloatArray

    def predict(
        self,
        t_s: FloatArray,
        orientations: FloatArray,
        angle_covariances: FloatArray,
        rates: FloatArray,
        rate_covariances: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return positions and velocities of the point, each with covariances, at times from the last one on.

        Parameters
        ----------
        t_s : ndarray (n,)
        orientations, angle_covariances : ndarray (n, 3, 3)
            Predicted ``R_reference_body`` and covariances of its rotation vector, reference axes, rad².
        rates, rate_covariances : ndarray (n, 3), (n, 3, 3)
            Angular rates in axes of the reference frame, rad/s, and their covariances.

        Returns
        -------
        positions, position covariances, velocities, velocity covariances
            (n, 3), m; (n, 3, 3); (n, 3), m/s; (n, 3, 3); in axes of the reference frame.
        """
        fit, dt = self.fit, np.maximum(t_s - self.last_s, 0.0)[:, None]
        arms = -(orientations @ fit.step)
        positions = fit.state[:3] + dt * fit.state[3:] + arms
        velocities = fit.state[3:] + np.cross(rates, arms)
        eye = np.eye(3)
        state_to_position = np.concatenate(
            [np.repeat(eye[None], len(t_s), axis=0), dt[:, :, None] * eye], axis=2
        )
        rate_matrices = se3.skew(rates)
        by_offset = -(state_to_position @ fit.state_derivatives) - orientations
        rate_by_offset = -fit.state_derivatives[3:] - rate_matrices @ orientations
        walk_variance = fit.intensity * dt[:, :, None] * eye
        arm_matrices = se3.skew(arms)
        position_covariances = (
            state_to_position @ fit.state_covariance @ np.swapaxes(state_to_position, 1, 2)
            + walk_variance * dt[:, :, None] ** 2 / 3.0
            + by_offset @ fit.covariance @ np.swapaxes(by_offset, 1, 2)
            + arm_matrices @ angle_covariances @ np.swapaxes(arm_matrices, 1, 2)
        )
        swept = rate_matrices @ arm_matrices
        velocity_covariances = (
            fit.state_covariance[3:, 3:]
            + walk_variance
            + rate_by_offset @ fit.covariance @ np.swapaxes(rate_by_offset, 1, 2)
            + swept @ angle_covariances @ np.swapaxes(swept, 1, 2)
            + arm_matrices @ rate_covariances @ np.swapaxes(arm_matrices, 1, 2)
        )
        return positions, position_covariances, velocities, velocity_covariances


def fit_centre(
    t_s: FloatArray,
    positions: FloatArray,
    covariances: FloatArray,
    orientations: FloatArray,
    *,
    sigma_m: float,
    is_noise_known: bool,
) -> CentreFit:
    """Return the centre of mass of a body.

    Parameters
    ----------
    t_s : ndarray (n,)
        Ascending times.
    positions, covariances : ndarray (n, 3), (n, 3, 3)
        Of a point of the body in the reference frame, m, m².
    orientations : ndarray (n, 3, 3)
        ``R_reference_body`` of the fitted rotation.
    sigma_m : float
        Prior standard deviation of the distance between the point and the centre, m.
    is_noise_known : bool
        False: the covariances are known up to a common factor.
    """
    weights = np.ones(len(t_s))
    for _ in range(_MAX_ROUNDS):
        fit = DriftingProblem(
            residuals=positions,
            derivatives=-orientations,
            covariances=covariances * weights[:, None, None],
            t_s=t_s,
            order=2,
            prior=np.eye(3) / sigma_m**2,
            is_noise_known=is_noise_known,
        ).solve()
        squared = np.einsum("ni,ni->n", fit.normalised, fit.normalised)
        updated = np.where(squared * weights > _OUTLIER, _EXCLUDED, 1.0)
        if np.array_equal(updated, weights):
            break
        weights = updated
    variances, axes = np.linalg.eigh(fit.covariance)
    is_unobservable = variances > (_UNOBSERVABLE * sigma_m) ** 2
    return CentreFit(fit, float(t_s[-1]), weights == 1.0, np.asarray(axes.T[is_unobservable]))

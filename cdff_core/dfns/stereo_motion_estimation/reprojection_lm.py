# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion between two stereo pairs by minimisation of the reprojection error in both images."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import DegenerateGeometryError, InputError, RefusedError
from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.stereo_motion_estimation.interface import Inputs, Interface, Outputs
from cdff_core.imaging.calibration_errors import (
    CalibrationUncertainty,
    corner_radius_px,
    measurement_errors,
    tracking_errors,
)
from cdff_core.imaging.rectified_camera import RectifiedCamera

_DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")

#: Standard deviations at which the Cauchy weight is 0.5.
_ROBUST_SCALE = 3.0
#: Lower bound of the factor on the covariance.
_MIN_UNIT_VARIANCE = 0.25


class ReprojectionLmConfig(DfnConfig):
    """Noise model and limits of ReprojectionLm."""

    sigma_track_px: float = Field(
        0.2, gt=0, le=10, description="Standard deviation of tracked columns and rows"
    )
    sigma_disparity_px: float = Field(0.2, gt=0, le=10, description="Standard deviation of a disparity")
    sigma_common_px: float = Field(
        0.02,
        ge=0,
        le=5,
        description="Standard deviation of an error of columns and rows common to all points, for example by "
        "pixel locking; use 0.003 for simulated images",
    )
    sigma_common_disparity_px: float = Field(
        0.015, ge=0, le=5, description="Standard deviation of a common error of disparities"
    )
    noise_factor: float = Field(
        2.7,
        ge=1,
        le=100,
        description="Factor on the covariance of the noise, since points are not independent",
    )
    gate: float = Field(
        3.4, gt=1, le=100, description="Largest Mahalanobis distance of the residual of an inlier"
    )
    max_iterations: int = Field(30, ge=1, le=200, description="Maximum number of Levenberg-Marquardt steps")
    calibration: CalibrationUncertainty = Field(
        CalibrationUncertainty(), description="Uncertainty of the calibration of the camera"
    )
    max_conditioning: float = Field(1e7, gt=1, description="Largest condition number of an observable motion")


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    """Inputs with matching shapes; without calibration parameters the bases have no columns."""

    camera: RectifiedCamera
    reference: FloatArray
    current: FloatArray
    reference_basis: FloatArray
    current_basis: FloatArray
    prior_mean: FloatArray
    prior_information: FloatArray

    @classmethod
    def from_inputs(cls, inputs: Inputs) -> _Problem:
        """Return the problem; raises InputError if shapes do not match."""
        reference, current = np.asarray(inputs.reference, np.float64), np.asarray(inputs.current, np.float64)
        n = len(reference)
        mean = np.zeros(0) if inputs.calibration is None else np.asarray(inputs.calibration, np.float64)
        k = len(mean)
        bases = [
            np.zeros((n, 0)) if basis is None else basis
            for basis in (inputs.reference_basis, inputs.current_basis)
        ]
        covariance = (
            np.zeros((0, 0)) if inputs.calibration_covariance is None else inputs.calibration_covariance
        )
        if any(basis.shape != (n, k) for basis in bases) or covariance.shape != (k, k):
            text = f"bases {bases[0].shape} and {bases[1].shape}, calibration covariance {covariance.shape}"
            raise InputError(f"{text}: expected ({n}, {k}), ({k}, {k})")
        camera = RectifiedCamera.from_matrix(inputs.camera_matrix, inputs.baseline)
        information = np.asarray(np.linalg.inv(covariance), np.float64)
        return cls(camera, reference, current, bases[0], bases[1], mean, information)


@dataclass(frozen=True, slots=True, eq=False)
class _System:
    """Linearised problem at an estimate.

    ``squared`` are the squared Mahalanobis distances of the residuals, ``projection`` (n, 6 + k, 3) maps
    residuals to the gradient, ``from_reference`` (n, 3, 3) is the derivative of the predicted measurements
    with respect to the reference measurements, ``cost`` is the robust cost.
    """

    residuals: FloatArray
    squared: FloatArray
    weights: FloatArray
    normal: FloatArray
    gradient: FloatArray
    projection: FloatArray
    from_reference: FloatArray
    reference: FloatArray
    current: FloatArray
    cost: float


class ReprojectionLm(Interface[ReprojectionLmConfig]):
    """Estimate the motion by weighted least squares; the uncertainty of the reference points is in the
    weights.

    The residual of a point is its measured minus predicted ``(u, v, d)`` in the current pair. Its covariance
    is that of the measurement plus the projected one of the triangulated reference point: to first order this
    is two-view bundle adjustment with the structure eliminated. The cost is robust (Cauchy) and minimised by
    Levenberg-Marquardt on ``R3 x SO(3)``.

    The covariance is ``s2 (J^T W J)^-1`` [1]_ times ``noise_factor``, plus the effect of errors common to all
    points (``tracking_errors``), which more points do not average out: pixel locking and the perspective of
    patches cause 0.002 to 0.015 px in simulated images, more in recorded ones. ``noise_factor`` accounts for
    the correlation of the points of a pair: their patches overlap, and their reference disparities are
    measured in the same images.

    Residual calibration errors affect near and far depths differently and are therefore observable in the
    motion itself [2]_: the calibration parameters are estimated together with the motion, from their prior
    and the derivatives in the two bases, and the covariance of the motion includes their remaining
    uncertainty. The remaining calibration errors (``CalibrationUncertainty``) are equal in all pairs. They
    are not estimated, but included in the covariance as common errors.

    References
    ----------
    .. [1] B. Triggs et al., Bundle Adjustment - A Modern Synthesis, 2000, doi:10.1007/3-540-44480-7_21, §4
      and §6
    .. [2] I. Kreso, S. Segvic, Improving the Egomotion Estimation by Correcting the Calibration Bias, VISAPP
       2015, doi:10.5220/0005316103470356
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the motion; raises RefusedError or DegenerateGeometryError."""
        problem = _Problem.from_inputs(inputs)
        if len(problem.reference) < 4:
            n = len(problem.reference)
            raise RefusedError(f"{n} points, expected at least 4", [f"few_inliers:{n}<4"])
        T = se3.inverse(inputs.guess)  # T_current_reference
        T[:3, :3] = se3.normalise_rotation(T[:3, :3])  # rounding errors accumulate in products of estimates
        theta = problem.prior_mean.copy()
        system = self._linearise(problem, T, theta)
        if not system.weights.sum() * 3.0 > 6.0:
            raise RefusedError("almost no point agrees with the guess", ["diverged"])
        damping = 1e-6
        for _ in range(self.config.max_iterations):
            step = np.linalg.solve(
                system.normal + damping * np.diag(np.diag(system.normal)), -system.gradient
            )
            candidate = se3.transform(se3.exp_so3(step[3:6]) @ T[:3, :3], T[:3, 3] + step[:3])
            trial = self._linearise(problem, candidate, theta + step[6:])
            if trial.cost > system.cost * (1.0 + 1e-9):
                damping *= 10.0
                if damping > 1e6:
                    break
                continue
            # Step below 1e-4 of the standard deviation of the estimate.
            has_converged = float(step @ system.normal @ step) < 1e-8
            T, theta, system, damping = candidate, theta + step[6:], trial, max(damping * 0.1, 1e-9)
            if has_converged:
                break
        return self._outputs(problem, T, theta, system)

    def _linearise(self, problem: _Problem, T_current_reference: FloatArray, theta: FloatArray) -> _System:
        """Return the linearised problem at a motion and calibration parameters ``theta``."""
        c, camera = self.config, problem.camera
        reference, current = problem.reference.copy(), problem.current.copy()
        reference[:, 2] = np.maximum(reference[:, 2] + problem.reference_basis @ theta, 0.05)
        current[:, 2] += problem.current_basis @ theta
        rotated = camera.triangulate(reference) @ T_current_reference[:3, :3].T
        points_in_camera = rotated + T_current_reference[:3, 3]
        behind = points_in_camera[:, 2] < 0.05
        points_in_camera[behind, 2] = 0.05
        residuals = current - camera.project(points_in_camera)
        J_point = camera.projection_jacobian(points_in_camera)
        # Derivative of the prediction with respect to the reference disparity, through the depth of the
        # point.
        J_reference = J_point @ T_current_reference[:3, :3] @ camera.triangulation_jacobian(reference)
        J_depth = J_reference[:, :, 2]
        noise = np.diag([c.sigma_track_px**2, c.sigma_track_px**2, c.sigma_disparity_px**2])
        W = np.linalg.inv(noise + c.sigma_disparity_px**2 * J_depth[:, :, None] * J_depth[:, None, :])
        squared = np.einsum("ni,nij,nj->n", residuals, W, residuals)
        squared[behind] = 1e12
        weights = 1.0 / (1.0 + squared / _ROBUST_SCALE**2)
        J_calibration = J_depth[:, :, None] * problem.reference_basis[:, None, :]
        J_calibration[:, 2, :] -= problem.current_basis
        J = np.concatenate([J_point, -J_point @ se3.skew(rotated), J_calibration], axis=2)
        JW = np.swapaxes(J, 1, 2) @ (W * weights[:, None, None])
        normal, gradient = (JW @ J).sum(axis=0), -(JW @ residuals[:, :, None]).sum(axis=0)[:, 0]
        prior_error = theta - problem.prior_mean
        normal[6:, 6:] += problem.prior_information
        gradient[6:] += problem.prior_information @ prior_error
        cost = float(np.sum(np.log1p(squared / _ROBUST_SCALE**2))) * _ROBUST_SCALE**2
        cost += float(prior_error @ problem.prior_information @ prior_error)
        return _System(
            residuals, squared, weights, normal, gradient, JW, J_reference, reference, current, cost
        )

    def _outputs(
        self, problem: _Problem, T_current_reference: FloatArray, theta: FloatArray, system: _System
    ) -> Outputs:
        """Return motion and covariances of a solution; raises RefusedError or DegenerateGeometryError."""
        c = self.config
        inliers = system.squared < c.gate**2
        if inliers.sum() < 4 or not np.all(np.isfinite(T_current_reference)):
            raise RefusedError(
                f"{inliers.sum()} points agree on a motion, expected at least 4",
                [f"few_inliers:{inliers.sum()}<4"],
            )
        conditioning, direction = self._weakest_direction(system.normal)
        if conditioning > c.max_conditioning:
            text = f"the points do not constrain {direction} (condition number {conditioning:.3g})"
            raise DegenerateGeometryError(text, [direction])
        freedom = max(3.0 * float(system.weights.sum()) - len(system.normal), 1.0)
        unit_variance = float((system.weights * system.squared).sum()) / freedom
        scale = max(unit_variance, _MIN_UNIT_VARIANCE)  # applies to the measurements, not to the prior
        information = system.normal / scale
        information[6:, 6:] += (1.0 - 1.0 / scale) * problem.prior_information
        inverse = np.linalg.inv(information)
        inverse = 0.5 * (inverse + inverse.T)
        J = cov.inverse_jacobian(T_current_reference)  # from the estimated T_current_reference to the motion
        tracking_sigmas = [
            c.sigma_common_px,
            c.sigma_common_px,
            c.sigma_common_disparity_px,
            *[c.sigma_common_px] * 3,
        ]
        modes = np.concatenate(
            [tracking_errors(system.reference), _calibration_modes(problem.camera, system)], 2
        )
        sigmas = np.concatenate([tracking_sigmas, c.calibration.sigmas()])
        common = J @ ((inverse @ (system.projection @ modes).sum(axis=0))[:6] / scale) * sigmas
        by_calibration = -J @ np.linalg.solve(information[:6, :6], information[:6, 6:])
        noise = c.noise_factor * J @ np.linalg.inv(information[:6, :6]) @ J.T
        noise = 0.5 * (noise + noise.T)
        systematic = by_calibration @ inverse[6:, 6:] @ by_calibration.T + common @ common.T
        return Outputs(
            motion=se3.inverse(T_current_reference),
            covariance=noise + 0.5 * (systematic + systematic.T),
            noise_covariance=noise,
            common_response=common,
            calibration_response=by_calibration,
            inliers=inliers,
            residuals=system.residuals,
            unit_variance=unit_variance,
            conditioning=conditioning,
            calibration=theta,
            calibration_covariance=inverse[6:, 6:],
        )

    @staticmethod
    def _weakest_direction(normal: FloatArray) -> tuple[float, str]:
        """Return the condition number of the normal matrix of the motion, with scaled rotations, and the
        direction that is constrained least.
        """
        H = normal[:6, :6]
        if len(normal) > 6:
            H = H - normal[:6, 6:] @ np.linalg.solve(normal[6:, 6:], normal[6:, :6])
        # Effective distance of the points.
        distance = np.sqrt(np.trace(H[3:, 3:]) / max(np.trace(H[:3, :3]), 1e-300))
        scale = np.array([1.0, 1.0, 1.0, *[1.0 / distance] * 3])
        values, vectors = np.linalg.eigh(H * np.outer(scale, scale))
        weakest = _DIRECTIONS[int(np.argmax(np.abs(vectors[:, 0])))]
        return float(values[-1] / max(values[0], 1e-300)), weakest


def _calibration_modes(camera: RectifiedCamera, system: _System) -> FloatArray:
    """Return the residuals ``(n, 3, 8)`` per unit of the calibration errors, which affect both pairs."""
    corner_px = corner_radius_px(camera, system.reference, system.current)
    current_errors = measurement_errors(camera, system.current, corner_px)
    reference_errors = measurement_errors(camera, system.reference, corner_px)
    return np.asarray(current_errors - system.from_reference @ reference_errors)

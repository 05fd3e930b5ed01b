# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion of a body without torque: a closed form of its rotation, fitted by least squares.

The fit allows for a slow drift of the reference frame, and for accelerations of the centre of mass, as random
walks whose intensities have the largest likelihood. Moments of inertia are estimated only if a rotation about
one axis is far less probable.
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.body_motion_estimation.interface import Inputs, Interface, Outputs
from cdff_core.rigid_body.centre_fit import CentreFit, fit_centre
from cdff_core.rigid_body.drifting_fit import compile_kernel
from cdff_core.rigid_body.motion_models import Tumble, value_derivatives
from cdff_core.rigid_body.rotation_fit import RotationFit, fit_rotation, is_at_middle_axis


class TorqueFreeConfig(DfnConfig):
    """Parameters of TorqueFree."""

    min_poses: int = Field(6, ge=4, le=1000, description="Least number of poses")
    centre_sigma_m: float = Field(
        2.0,
        gt=0,
        le=1e5,
        description="Standard deviation of the distance of the centre of mass from the body's origin",
    )
    min_rotation_sigmas: float = Field(
        5.0, ge=1, le=100, description="Angular rate in standard deviations from which a body rotates"
    )
    max_ratio_sigma: float = Field(
        0.05,
        gt=0,
        le=1,
        description="Standard deviation of a ratio of moments of inertia above which they are unobservable",
    )


class TorqueFree(Interface[TorqueFreeConfig]):
    """Motion without torque. A fit starts from the previous one if its poses are later ones."""

    def setup(self) -> None:
        """Compile the kernel of the fits; clear the previous fit."""
        compile_kernel()
        self._rotation: RotationFit | None = None
        self._centre: CentreFit | None = None

    def process(self, inputs: Inputs) -> Outputs:
        """Return the motion.

        Raises
        ------
        RefusedError
            With fewer poses than `min_poses`.
        InputError
            If times do not ascend, a query precedes the last pose, or a pose is no rigid transform.
        """
        self._check(inputs)
        if self._rotation is None or self._centre is None or not inputs.is_fitted:
            self._rotation, self._centre = self._fit(inputs, self._rotation)
        fit, centre = self._rotation, self._centre
        R = inputs.poses[:, :3, :3]
        orientations, angles, rates, rate_covariances = fit.predict(inputs.queries_s)
        positions, places, speeds, speed_covariances = centre.predict(
            inputs.queries_s, orientations, angles, rates, rate_covariances
        )
        arms = se3.skew(-(orientations @ centre.fit.step))
        cross, speed_cross = -arms @ angles, -arms @ rate_covariances
        axis, axis_sigma, rate, rate_sigma = self._axis(fit)
        ratios, ratios_covariance, principal = self._inertia(fit)
        return Outputs(
            poses=se3.transform(orientations, positions),
            covariances=_blocks(places, cross, angles),
            velocities=np.concatenate([speeds, rates], axis=1),
            velocity_covariances=_blocks(speed_covariances, speed_cross, rate_covariances),
            axis=axis,
            axis_sigma_rad=axis_sigma,
            rate_rad_s=rate,
            rate_sigma_rad_s=rate_sigma,
            moment_ratios=ratios,
            moment_ratios_covariance=ratios_covariance,
            principal_axes=principal,
            is_tumbling=isinstance(fit.model, Tumble),
            may_tumble=fit.may_tumble,
            centre_m=centre.fit.step,
            centre_covariance=centre.fit.covariance,
            unobservable=centre.unobservable,
            outliers=int((~(fit.inliers & centre.inliers)).sum()),
            noise_factor=float(fit.fit.noise_factor),
            increment_rad=float(np.median(se3.rotation_angle(np.swapaxes(R[:-1], 1, 2) @ R[1:]))),
        )

    def _fit(self, inputs: Inputs, previous: RotationFit | None) -> tuple[RotationFit, CentreFit]:
        """Return the fits to all poses."""
        t_s, poses = inputs.times_s, inputs.poses
        is_later = previous is not None and previous.epoch_s <= t_s[0] <= previous.last_s < t_s[-1]
        rotation = fit_rotation(
            t_s,
            poses[:, :3, :3],
            inputs.covariances[:, 3:, 3:],
            is_noise_known=inputs.is_noise_known,
            guess=previous if is_later else None,
        )
        centre = fit_centre(
            t_s,
            poses[:, :3, 3],
            inputs.covariances[:, :3, :3],
            rotation.model.orientations(t_s - rotation.epoch_s),
            sigma_m=self.config.centre_sigma_m,
            is_noise_known=inputs.is_noise_known,
        )
        return rotation, centre

    def _check(self, inputs: Inputs) -> None:
        """Raise RefusedError for too few poses, InputError for unordered
        times or poses that are not rigid.
        """
        t_s = inputs.times_s
        if len(t_s) < self.config.min_poses:
            raise RefusedError(
                f"{len(t_s)} poses, expected at least {self.config.min_poses}",
                reasons=[f"few_poses:{len(t_s)}"],
            )
        if (np.diff(t_s) <= 0.0).any():
            row = int(np.argmax(np.diff(t_s) <= 0.0)) + 1
            raise InputError(
                f"times_s[{row}]={t_s[row]:.6f} after {t_s[row - 1]:.6f}: expected ascending times"
            )
        if len(inputs.queries_s) and inputs.queries_s.min() < t_s[-1]:
            raise InputError(
                f"queries_s: {inputs.queries_s.min():.6f} s precedes the last pose at {t_s[-1]:.6f} s"
            )
        if not (is_rigid := se3.are_transforms(inputs.poses)).all():
            raise InputError(f"poses[{int(np.argmin(is_rigid))}]: expected a rigid transform")

    def _axis(self, fit: RotationFit) -> tuple[FloatArray | None, float, float, float]:
        """Return axis, its standard deviation, mean rate and its standard deviation."""
        model = fit.model
        by_rate = value_derivatives(model, lambda m: np.array([m.mean_rate_rad_s]))
        rate = model.mean_rate_rad_s
        rate_sigma = float(np.sqrt((by_rate @ fit.fit.covariance @ by_rate.T)[0, 0]))
        if rate < self.config.min_rotation_sigmas * rate_sigma:
            return None, 0.0, rate, rate_sigma
        by_axis = value_derivatives(model, lambda m: m.momentum_axis)
        variance = np.linalg.eigvalsh(by_axis @ fit.fit.covariance @ by_axis.T)[-1]
        span_s = fit.last_s - fit.epoch_s
        return model.momentum_axis, float(np.sqrt(variance + fit.fit.intensity * span_s)), rate, rate_sigma

    def _inertia(self, fit: RotationFit) -> tuple[FloatArray | None, FloatArray | None, FloatArray | None]:
        """Return the ratios of the moments, their covariance and the principal axes; None if unobservable."""
        model = fit.model
        if not isinstance(model, Tumble) or is_at_middle_axis(fit):
            return None, None, None
        by_ratios = value_derivatives(model, lambda m: m.moment_ratios)
        covariance = by_ratios @ fit.fit.covariance @ by_ratios.T
        if np.sqrt(np.diagonal(covariance).max()) > self.config.max_ratio_sigma:
            return None, None, None
        _, axes = np.linalg.eigh(model.inertia)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        return model.moment_ratios, covariance, axes


def _blocks(first: FloatArray, cross: FloatArray, second: FloatArray) -> FloatArray:
    """Return the symmetric matrices (n, 6, 6) of blocks (n, 3, 3)."""
    return np.block([[first, cross], [np.swapaxes(cross, 1, 2), second]])

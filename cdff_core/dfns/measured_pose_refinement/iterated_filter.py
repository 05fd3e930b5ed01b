# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Iterated Kalman filter with edge points: the nearest hypothesis of each, robustly weighted."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import symmetrised
from cdff_common.geometry.robust import median_sigma
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.measured_pose_refinement.interface import Inputs, Interface, Outputs

#: Least number of points with weight, and largest residual of an agreeing point, standard deviations.
_MIN_POINTS, _SIGMAS = 6, 3.0


class IteratedFilterConfig(DfnConfig):
    """Parameters of IteratedFilter."""

    iterations: int = Field(6, ge=1, le=50, description="Gauss-Newton steps")
    sigma_px: float = Field(0.4, gt=0, le=20, description="Standard deviation of an edge point, px")
    limit_sigmas: float = Field(
        4.0, ge=1, le=20, description="Residual from which a point has no weight at last, standard deviations"
    )
    bias_px: float = Field(0.05, ge=0, le=10, description="Error that all points share, px")
    false_share: float = Field(
        0.1,
        ge=0,
        le=1,
        description="Fraction of hidden points, those without an image edge, that meet other edges",
    )
    inflation: float = Field(
        4.0,
        ge=1,
        le=100,
        description="Factor of the covariance of the points: errors of neighbours correlate",
    )


class IteratedFilter(Interface[IteratedFilterConfig]):
    """Each step is one of an iterated Kalman filter (Bell and Cathey 1993, doi:10.1109/9.250476) whose
    measurements are the residuals along the normals with Tukey's weights; the limit of the residuals shrinks
    from ``limit_px`` to that of the noise.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the corrected state; raises InputError or RefusedError."""
        cfg, P = self.config, inputs.prior_covariance
        k = len(P)
        if k < 6:
            raise InputError(f"prior_covariance {P.shape}: expected at least 6 errors, those of the pose")
        prior_error = np.zeros(k) if inputs.prior_error is None else inputs.prior_error
        correction, T = np.zeros(k), np.array(inputs.pose, np.float64)
        last_px = cfg.limit_sigmas * cfg.sigma_px
        scale = np.ones(len(inputs.points))
        if inputs.sigmas is not None:
            scale = cfg.sigma_px / np.maximum(inputs.sigmas, 1e-9)
        for limit_px in np.geomspace(max(inputs.limit_px, last_px), last_px, cfg.iterations):
            r, J = residuals_and_jacobian(inputs, T, scale)
            is_near = np.abs(r) < limit_px
            weights = np.where(is_near, (1.0 - np.square(np.where(is_near, r, 0.0) / limit_px)) ** 2, 0.0)
            count = int(np.count_nonzero(is_near))
            if count < _MIN_POINTS:
                raise RefusedError(
                    f"{count} of {len(r)} edge points have an image edge within {limit_px:.2g} px",
                    [f"few_edges:{count}<{_MIN_POINTS}"],
                )
            # With a wide limit, the points that are not explained are noise.
            sigma2 = max(cfg.sigma_px, 0.25 * float(limit_px)) ** 2
            # Points of hidden parts that meet other edges shift the pose together.
            false_share = cfg.false_share * (len(r) - count) / count
            bias2 = cfg.bias_px**2 + (false_share * last_px) ** 2
            variance = cfg.inflation * (sigma2 + weights.sum() * bias2)
            information = J.T @ (J * weights[:, None]) / variance
            gradient = np.zeros(k)
            gradient[:6] = J.T @ (weights * np.where(is_near, r, 0.0)) / variance
            H = np.zeros((k, k))
            H[:6, :6] = information
            # (P^-1 + H)^-1 (P^-1 e + J^T b), without the inverse of P.
            delta = np.linalg.solve(np.eye(k) + P @ H, P @ gradient + prior_error - correction)
            correction = correction + delta
            R = se3.normalise_rotation(se3.exp_so3(delta[3:6]) @ T[:3, :3])
            T = se3.transform(R, T[:3, 3] + delta[:3])
        r, _ = residuals_and_jacobian(inputs, T, scale)
        is_inlier = np.abs(r) < last_px
        return Outputs(
            correction=correction,
            covariance=symmetrised(np.linalg.solve(np.eye(k) + P @ H, P)),
            information=symmetrised(information),
            agreement=float(np.mean(np.abs(r) < _SIGMAS * cfg.sigma_px)),
            sigma_px=median_sigma(r[is_inlier]) if is_inlier.any() else float("nan"),
        )


def residuals_and_jacobian(
    inputs: Inputs, T_camera_body: FloatArray, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the smallest residual (n,) of each point, NaN without one, and its derivative (n, 6).

    A residual is the measured minus the predicted offset, times ``scale`` (n,); the derivative is that of the
    predicted one.
    """
    K = inputs.camera_matrix
    arms = inputs.points @ T_camera_body[:3, :3].T
    x, y, z = (arms + T_camera_body[:3, 3]).T
    # Points that a step moves behind the camera have no residual.
    z = np.where(z > 0.0, z, np.nan)
    u, v = K[0, 0] * x / z + K[0, 2], K[1, 1] * y / z + K[1, 2]
    nu, nv = inputs.normals.T
    distance_along_normal = nu * (u - inputs.pixels[:, 0]) + nv * (v - inputs.pixels[:, 1])
    distances = np.abs(inputs.offsets - distance_along_normal[:, None])
    nearest = np.argmin(np.where(np.isnan(distances), np.inf, distances), axis=1)
    r = inputs.offsets[np.arange(len(distance_along_normal)), nearest] - distance_along_normal
    gx, gy = nu * K[0, 0] / z, nv * K[1, 1] / z
    g = np.stack([gx, gy, -(gx * x + gy * y) / z], axis=1)
    J = np.nan_to_num(np.hstack([g, np.cross(arms, g)]))
    return scale * r, scale[:, None] * J

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Relative pose from the decomposition of an essential matrix."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import DegenerateGeometryError
from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_core.dfns.cameras_transform_estimation.interface import Inputs, Interface, Outputs
from cdff_core.imaging.magsac import InlierConfig, pairs, refuse_few_inliers
from cdff_core.imaging.relative_pose import angles, checked_cameras, decomposed, depths, fit_in_front, rays
from cdff_core.imaging.two_view import tangents

#: Median residual of the best pure rotation, in standard deviations, below which translation is unobservable.
_MIN_PARALLAX_SIGMAS = 3.0


class EssentialDecompositionConfig(InlierConfig):
    """Parameters of EssentialDecomposition."""

    min_inliers: int = Field(12, ge=6, description="Minimum number of inliers; fewer are refused")


class EssentialDecomposition(Interface[EssentialDecompositionConfig]):
    """Rotation and direction of translation [1]_, refined by minimising the Sampson distance of the inliers.

    Of the four decompositions, that with most points in front of both cameras is used.

    References
    ----------
    .. [1] R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., 2004, doi:10.1017/CBO9780511811685, §9.6
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the relative pose.

        Raises RefusedError if too few pairs are inliers, DegenerateGeometryError for a pure rotation.
        """
        cfg = self.config
        source, sink = pairs(inputs.source, inputs.sink, cfg.min_inliers)
        E = np.asarray(inputs.essential_matrix, np.float64)
        K = checked_cameras(inputs.source_camera, inputs.sink_camera)
        source_rays, sink_rays = rays(source, K[0]), rays(sink, K[1])
        R, t, _ = decomposed(E, source_rays, sink_rays)
        fit, R, t = fit_in_front(R, t, K, source, sink, cfg.gate_sigmas, cfg.threshold_px)
        sigma_rad = fit.sigma_px / float(np.sqrt(K[1][0, 0] * K[1][1, 1]))
        self._refuse_rotation(source_rays[fit.inliers], sink_rays[fit.inliers], sigma_rad)
        source_depths, sink_depths = depths(R, t, source_rays, sink_rays)
        inliers = fit.inliers & (source_depths > 0.0) & (sink_depths > 0.0)
        refuse_few_inliers(inliers, cfg.min_inliers)
        parallax = float(np.median(angles(source_rays[inliers] @ R.T, sink_rays[inliers])))
        # Derivative of the pose perturbation by the five parameters: rotation, direction of translation.
        J = np.zeros((6, 5))
        J[:3, 3:], J[3:, :3] = tangents(t), np.eye(3)
        T_sink_source = se3.transform(R, t)
        covariance = cov.inverse_covariance(T_sink_source, J @ fit.parameters @ J.T)
        return Outputs(
            transform=se3.inverse(T_sink_source),
            covariance=covariance,
            inliers=inliers,
            parallax_deg=float(np.degrees(parallax)),
        )

    def _refuse_rotation(self, source_rays: FloatArray, sink_rays: FloatArray, sigma_rad: float) -> None:
        """Raise DegenerateGeometryError if the best pure rotation (Kabsch 1976) explains the pairs."""
        if len(source_rays) < 3:
            return
        unit_rays = [
            vectors / np.linalg.norm(vectors, axis=1, keepdims=True) for vectors in (source_rays, sink_rays)
        ]
        U, _, Vt = np.linalg.svd(unit_rays[1].T @ unit_rays[0])
        rotation = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
        residual_rad = float(np.median(angles(unit_rays[0] @ rotation.T, unit_rays[1])))
        if residual_rad < _MIN_PARALLAX_SIGMAS * sigma_rad:
            residual_deg, sigma_deg = np.degrees(residual_rad), np.degrees(sigma_rad)
            raise DegenerateGeometryError(
                f"a pure rotation has a residual of {residual_deg:.4f} deg, noise {sigma_deg:.4f} deg",
                ["translation"],
            )

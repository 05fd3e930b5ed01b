# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Relative pose from the decomposition of an essential matrix."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import DegenerateGeometryError, RefusedError
from cdff_common.geometry import covariance as cov
from cdff_common.geometry import se3
from cdff_core.dfns.cameras_transform_estimation.interface import Inputs, Interface, Outputs
from cdff_core.imaging.magsac import CalibrationConfig, InlierConfig, pairs, refuse_few_inliers
from cdff_core.imaging.relative_pose import (
    MIN_IN_FRONT,
    angles,
    checked_cameras,
    decompose_essential,
    depths,
    fit_in_front,
    rays,
)
from cdff_core.imaging.relative_pose_search import best_rotation
from cdff_core.imaging.sampson import compile_kernels
from cdff_core.imaging.two_view import tangents

#: Median residual of the best pure rotation, in standard deviations, below which translation is unobservable.
_MIN_PARALLAX_SIGMAS = 3.0


class EssentialDecompositionConfig(InlierConfig, CalibrationConfig):
    """Parameters of EssentialDecomposition."""

    min_inliers: int = Field(12, ge=6, description="Minimum number of inliers; fewer are refused")


class EssentialDecomposition(Interface[EssentialDecompositionConfig]):
    """Rotation and direction of translation [1]_, refined by minimising the Sampson distance of the inliers.

    Of the four decompositions, that with most points in front of both cameras is used.

    References
    ----------
    .. [1] R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., 2004, doi:10.1017/CBO9780511811685, §9.6
    """

    def setup(self) -> None:
        """Compile the kernels."""
        compile_kernels()

    def process(self, inputs: Inputs) -> Outputs:
        """Return the relative pose.

        Raises RefusedError if too few pairs are inliers or too many intersect behind a camera, and
        DegenerateGeometryError for a pure rotation.
        """
        cfg = self.config
        source, sink = pairs(inputs.source, inputs.sink, cfg.min_inliers)
        E = np.asarray(inputs.essential_matrix, np.float64)
        K = checked_cameras(inputs.source_camera, inputs.sink_camera)
        source_rays, sink_rays = rays(source, K[0]), rays(sink, K[1])
        R, t, _ = decompose_essential(E, source_rays, sink_rays)
        fit, R, t = fit_in_front(R, t, K, source, sink, cfg.gate_sigmas, cfg.threshold_px, cfg.lenses)
        sigma_rad = fit.sigma_px / float(np.sqrt(K[1][0, 0] * K[1][1, 1]))
        self._refuse_rotation(source_rays[fit.inliers], sink_rays[fit.inliers], sigma_rad)
        source_depths, sink_depths = depths(R, t, source_rays, sink_rays)
        is_in_front = (source_depths > 0.0) & (sink_depths > 0.0)
        has_parallax = angles(source_rays @ R.T, sink_rays) > _MIN_PARALLAX_SIGMAS * np.sqrt(2.0) * sigma_rad
        agrees = fit.residuals < cfg.gate_sigmas * fit.sigma_px
        self._refuse_points_behind(is_in_front, has_parallax & agrees)
        inliers = fit.inliers & is_in_front
        refuse_few_inliers(inliers, cfg.min_inliers)
        parallax = float(np.median(angles(source_rays[inliers] @ R.T, sink_rays[inliers])))
        # Derivative of the pose perturbation with respect to the five parameters: rotation, direction of
        # translation.
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

    def _refuse_points_behind(self, is_in_front: BoolArray, has_parallax: BoolArray) -> None:
        """Raise RefusedError if too many of the pairs with parallax intersect behind a camera."""
        if has_parallax.any() and (ratio := float(is_in_front[has_parallax].mean())) < MIN_IN_FRONT:
            text = f"{ratio:.2f} of the pairs are in front of both cameras, expected {MIN_IN_FRONT}"
            raise RefusedError(text, [f"behind_camera:{ratio:.2f}<{MIN_IN_FRONT:g}"])

    def _refuse_rotation(self, source_rays: FloatArray, sink_rays: FloatArray, sigma_rad: float) -> None:
        """Raise DegenerateGeometryError if the best pure rotation explains the pairs."""
        if len(source_rays) < 3:
            return
        rotation = best_rotation(source_rays, sink_rays)
        residual_rad = float(np.median(angles(source_rays @ rotation.T, sink_rays)))
        if residual_rad < _MIN_PARALLAX_SIGMAS * sigma_rad:
            residual_deg, sigma_deg = np.degrees(residual_rad), np.degrees(sigma_rad)
            raise DegenerateGeometryError(
                f"a pure rotation has a residual of {residual_deg:.4f} deg, noise {sigma_deg:.4f} deg",
                ["translation"],
            )

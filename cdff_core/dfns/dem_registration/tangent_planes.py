# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registration of points with the tangent planes of an elevation map, with the pose's covariance as prior.

References
----------
.. [1] Rosenholm, D., Torlegård, K. (1988). Three-dimensional absolute orientation of stereo models using
   digital elevation models. Photogrammetric Engineering and Remote Sensing 54(10): least-squares matching of
   heights.
.. [2] Holland, P. W., Welsch, R. E. (1977). Robust regression using iteratively reweighted least-squares.
   doi:10.1080/03610927708827533 (the biweight and its constant)
"""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.points import checked_points
from cdff_common.geometry.robust import median_sigma
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_registration._kernels import tangent_planes
from cdff_core.dfns.dem_registration.interface import Inputs, Interface, Outputs

#: Constant of the biweight for an efficiency of 95 % with Gaussian residuals [2]_.
_BIWEIGHT = 4.685
#: Half width in cells of the square to which a plane of the map is fitted.
_RADIUS_CELLS = 2
#: Minimum number of matched points for a correction.
_MIN_POINTS = 200
#: Factor on the covariance of the residuals, since those of neighbouring points are correlated.
_INFLATION = 10.0
#: Largest squared Mahalanobis norm of a correction under the prior; correct priors practically never exceed
#: it.
_MAX_CHI2 = 40.0
#: Added to the variances of the pose, so that a singular covariance has an inverse.
_MIN_VARIANCE = 1e-10


class TangentPlanesConfig(DfnConfig):
    """Parameters of TangentPlanes."""

    max_points: int = Field(6000, ge=10, description="Maximum number of points used; more are thinned")
    min_overlap: float = Field(0.2, ge=0, le=1, description="Minimum fraction of the points on the map")
    iterations: int = Field(8, ge=1, le=100, description="Iterations of matching and solving")
    map_sigma_m: float = Field(
        0.003, gt=0, le=10, description="Standard deviation of the map added to that of the fitted planes"
    )


class TangentPlanes(Interface[TangentPlanesConfig]):
    """Iteratively reweighted least squares of six parameters, with the covariance of the pose as prior.

    The residual of a point is its height above the plane fitted to the surrounding cells of the map [1]_. The
    biweight reduces the influence of rocks and moved objects [2]_. Flat terrain constrains only height and
    tilt; x, y and heading then keep their prior.
    """

    def setup(self) -> None:
        """Compile the kernel."""
        heights = np.zeros((5, 5), np.float32)
        # Layers of a message are read-only, which is another type for the compiler.
        heights.setflags(write=False)
        self._fit_planes(np.zeros((1, 3)), heights, (0.1, 0.0, 0.5))

    def process(self, inputs: Inputs) -> Outputs:
        """Return the correction; raises InputError if a point is not finite or the covariance is invalid."""
        cfg = self.config
        all_points = checked_points(inputs.points, least=0)
        noise = np.asarray(inputs.noise_variance, dtype=np.float64)
        prior = np.asarray(inputs.covariance, dtype=np.float64)
        if np.linalg.eigvalsh(prior)[0] < -1e-9:
            raise InputError("covariance: expected a positive semi-definite 6x6 matrix")
        no_correction = Outputs(correction=np.eye(4), covariance=prior, matched=0)
        stride = -(-len(all_points) // cfg.max_points) if len(all_points) else 1
        points, noise = all_points[::stride], noise[::stride]
        prior_information = np.linalg.inv(prior + _MIN_VARIANCE * np.eye(6))
        grid = _grid_of(inputs.map)
        correction = np.zeros(6)
        posterior_information = prior_information
        for _ in range(cfg.iterations):
            corrected_points = se3.transform_points(_transform_about(inputs.centre, correction), points)
            planes = self._fit_planes(corrected_points, inputs.map.layer("mean"), grid)
            height_above_m, gradient, plane_variance_m2 = planes
            on_map = np.isfinite(height_above_m)
            matched = int(np.count_nonzero(on_map))
            if matched < _MIN_POINTS or matched < cfg.min_overlap * len(points):
                return no_correction
            residuals_m, slopes = height_above_m[on_map], gradient[on_map]
            variance = (
                noise[on_map] * (1.0 + (slopes**2).sum(axis=1))
                + plane_variance_m2[on_map]
                + self._map_variance(inputs.map, corrected_points[on_map])
            )
            scale = max(median_sigma(residuals_m / np.sqrt(variance)), 1.0)
            scaled = residuals_m / (_BIWEIGHT * scale * np.sqrt(variance))
            biweight = np.where(np.abs(scaled) < 1.0, (1.0 - scaled**2) ** 2, 0.0)
            weight = biweight / (variance * scale**2)
            J = _jacobian(corrected_points[on_map] - inputs.centre, slopes)
            JW = J * weight[:, None]
            posterior_information = prior_information + JW.T @ J / _INFLATION
            gradient_of_cost = JW.T @ residuals_m / _INFLATION + prior_information @ correction
            update = np.linalg.solve(posterior_information, -gradient_of_cost)
            correction = correction + update
            if np.abs(update).max() < 1e-6:
                break
        if correction @ prior_information @ correction > _MAX_CHI2:
            return no_correction
        return Outputs(
            correction=_transform_about(inputs.centre, correction),
            covariance=np.linalg.inv(posterior_information),
            matched=matched,
        )

    def _map_variance(self, dem: ElevationMap, points: FloatArray) -> FloatArray:
        """Return the variance of the map height at each point, without the scatter of the cells, m^2."""
        variance = np.full(len(points), self.config.map_sigma_m**2)
        if "error_variance" not in dem.layer_names:
            return variance
        row, col, inside = dem.geometry.cells_of(points[:, 0], points[:, 1])
        map_error = dem.layer("error_variance") - dem.layer("pose_variance")
        variance[inside] += np.nan_to_num(map_error[row[inside], col[inside]])
        return variance

    def _fit_planes(
        self, points: FloatArray, heights: Float32Array, corner: tuple[float, float, float]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return heights above the planes ``(n,)``, their slopes ``(n, 2)`` and variances ``(n,)``."""
        n = len(points)
        height_above_m, gradient, plane_variance_m2 = np.empty(n), np.empty((n, 2)), np.empty(n)
        tangent_planes(points, heights, *corner, _RADIUS_CELLS, height_above_m, gradient, plane_variance_m2)
        return height_above_m, gradient, plane_variance_m2


def _grid_of(dem: ElevationMap) -> tuple[float, float, float]:
    """Return the edge of a cell, and x and y of the upper left corner, metres."""
    g = dem.geometry
    return g.resolution_m, g.xmin_m, g.ymax_m


def _transform_about(centre: FloatArray, correction: FloatArray) -> FloatArray:
    """Return the transform that translates by ``d[:3]`` and rotates by ``d[3:]`` about a point."""
    R = se3.exp_so3(correction[3:])
    return np.asarray(se3.transform(R, centre + correction[:3] - R @ centre))


def _jacobian(lever_arm_m: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return the derivatives ``(n, 6)`` of the heights above the planes with respect to translation and
    rotation.

    ``lever_arm_m`` is the offset of each point from the centre of rotation.
    """
    normal = np.column_stack([-slopes, np.ones(len(slopes))])
    return np.hstack([normal, np.cross(lever_arm_m, normal)])

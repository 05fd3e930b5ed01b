# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registration of points with the tangent planes of an elevation map, with the pose's covariance as prior.

References
----------
.. [1] Rosenholm, D., Torlegård, K. (1988). Three-dimensional absolute orientation of stereo models using
   digital
   elevation models. Photogrammetric Engineering and Remote Sensing 54(10): least-squares matching of heights.
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

_BIWEIGHT = 4.685
#: Half width in cells of the square to which a plane of the map is fitted.
_RADIUS_CELLS = 2
#: Minimum number of matched points for a correction.
_MIN_POINTS = 200
#: Factor on the covariance, since residuals of neighbours are correlated.
_INFLATION = 10.0
#: Largest squared Mahalanobis norm of a correction: far above what 6 degrees of freedom reach by chance.
_MAX_CHI2 = 40.0
#: Added to the variances of the pose, so that a singular covariance has an inverse.
_LEAST_VARIANCE = 1e-10


class TangentPlanesConfig(DfnConfig):
    """Parameters of TangentPlanes."""

    max_points: int = Field(6000, ge=10, description="Maximum number of points used")
    min_overlap: float = Field(0.2, ge=0, le=1, description="Minimum fraction of the points on the map")
    iterations: int = Field(8, ge=1, le=100, description="Iterations of matching and solving")
    map_sigma_m: float = Field(
        0.003, gt=0, le=10, description="Standard deviation of the map's planes beyond their scatter"
    )


class TangentPlanes(Interface[TangentPlanesConfig]):
    """Iteratively reweighted least squares of six parameters, with the covariance of the pose as prior.

    The residual of a point is its height over the plane through the surrounding cells of the map [1]_; rocks
    and moved objects are down-weighted [2]_. Flat terrain constrains height and tilt; east, north and heading
    then follow the prior.
    """

    def setup(self) -> None:
        """Compile the kernel."""
        heights = np.zeros((5, 5), np.float32)
        heights.setflags(
            write=False
        )  # layers of a message are read-only, which is another type to the compiler
        self._over(np.zeros((1, 3)), heights, (0.1, 0.0, 0.5))

    def process(self, inputs: Inputs) -> Outputs:
        """Return the correction; raises InputError on a point that is not finite or an invalid covariance."""
        c = self.config
        given = checked_points(inputs.points, least=0)
        noise = np.asarray(inputs.noise_variance, dtype=np.float64)
        prior = np.asarray(inputs.covariance, dtype=np.float64)
        if np.linalg.eigvalsh(prior)[0] < -1e-9:
            raise InputError("covariance: expected a positive semi-definite 6x6 matrix")
        nothing = Outputs(correction=np.eye(4), covariance=prior, matched=0)
        step = -(-len(given) // c.max_points) if len(given) else 1
        points, noise = given[::step], noise[::step]
        information = np.linalg.inv(prior + _LEAST_VARIANCE * np.eye(6))
        grid = _grid(inputs.map)
        d = np.zeros(6)
        fitted = information
        for _ in range(c.iterations):
            moved = se3.transform_points(_about(inputs.centre, d), points)
            above, gradient, spread = self._over(moved, inputs.map.layer("mean"), grid)
            on = np.isfinite(above)
            matched = int(np.count_nonzero(on))
            if matched < _MIN_POINTS or matched < c.min_overlap * len(points):
                return nothing
            r, g = above[on], gradient[on]
            variance = (
                noise[on] * (1.0 + (g**2).sum(axis=1)) + spread[on] + self._of_map(inputs.map, moved[on])
            )
            scale = max(median_sigma(r / np.sqrt(variance)), 1.0)
            u = r / (_BIWEIGHT * scale * np.sqrt(variance))
            weight = np.where(np.abs(u) < 1.0, (1.0 - u**2) ** 2, 0.0) / (variance * scale**2)
            J = _jacobian(moved[on] - inputs.centre, g)
            JW = J * weight[:, None]
            fitted = information + JW.T @ J / _INFLATION
            update = np.linalg.solve(fitted, -(JW.T @ r) / _INFLATION - information @ d)
            d = d + update
            if np.abs(update).max() < 1e-6:
                break
        if d @ information @ d > _MAX_CHI2:
            return nothing
        return Outputs(correction=_about(inputs.centre, d), covariance=np.linalg.inv(fitted), matched=matched)

    def _of_map(self, dem: ElevationMap, points: FloatArray) -> FloatArray:
        """Return the variance of the map at each point beyond its cells' scatter, square metres."""
        least = np.full(len(points), self.config.map_sigma_m**2)
        if "error_variance" not in dem.layer_names:
            return least
        row, col, inside = dem.geometry.cells_of(points[:, 0], points[:, 1])
        error = dem.layer("error_variance") - dem.layer("pose_variance")
        least[inside] += np.nan_to_num(error[row[inside], col[inside]])
        return least

    def _over(
        self, points: FloatArray, heights: Float32Array, grid: tuple[float, float, float]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        above, gradient, spread = np.empty(len(points)), np.empty((len(points), 2)), np.empty(len(points))
        tangent_planes(points, heights, *grid, _RADIUS_CELLS, above, gradient, spread)
        return above, gradient, spread


def _grid(dem: ElevationMap) -> tuple[float, float, float]:
    g = dem.geometry
    return g.resolution_m, g.xmin_m, g.ymax_m


def _about(centre: FloatArray, d: FloatArray) -> FloatArray:
    """Return the transform that translates by ``d[:3]`` and rotates by ``d[3:]`` about a point."""
    R = se3.exp_so3(d[3:])
    return np.asarray(se3.transform(R, centre + d[:3] - R @ centre))


def _jacobian(arm: FloatArray, gradient: FloatArray) -> FloatArray:
    """Return the derivative of the heights over the planes by translation and rotation, shape (n, 6)."""
    normal = np.column_stack([-gradient, np.ones(len(gradient))])
    return np.hstack([normal, np.cross(arm, normal)])

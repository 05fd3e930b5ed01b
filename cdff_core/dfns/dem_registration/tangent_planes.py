# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Heights of points over the planes of a map, made as small as the pose's covariance allows.

References
----------
.. [1] Rosenholm, D., Torlegård, K. (1988). Three-dimensional absolute orientation of stereo models using digital
   elevation models. Photogrammetric Engineering and Remote Sensing 54(10): least-squares matching of heights.
.. [2] Holland, P. W., Welsch, R. E. (1977). Robust regression using iteratively reweighted least-squares.
   doi:10.1080/03610927708827533 (the biweight and its constant)
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_registration._interface import (
    DemRegistrationInputs,
    DemRegistrationInterface,
    DemRegistrationOutputs,
)

Array = NDArray[np.float64]

_BIWEIGHT = 4.685
#: A direction in which the pose is said to be exact is let go by this much, so that the covariance has an inverse.
_LEAST_VARIANCE = 1e-10


class TangentPlanesConfig(DfnConfig):
    """Matching, solving, refusing."""

    radius_cells: int = Field(2, ge=1, le=20, description="Half width of a plane's square of cells")
    max_points: int = Field(6000, ge=10, description="Points used at most")
    min_points: int = Field(200, ge=10, description="Matched points below which nothing is corrected")
    min_overlap: float = Field(0.2, ge=0.0, le=1.0, description="Share of points on the map that is needed")
    iterations: int = Field(8, ge=1, le=100, description="Rounds of matching and solving")
    map_sigma_m: float = Field(0.003, gt=0.0, le=10.0, description="Of the planes, beyond their cells' scatter, metres")
    inflation: float = Field(10.0, ge=1.0, le=1e4, description="Of the fit's covariance, for correlated residuals")
    max_chi2: float = Field(40.0, gt=0.0, description="Largest squared correction by the pose's covariance")


class TangentPlanes(DemRegistrationInterface):
    """Iteratively reweighted least squares of six numbers, the pose's covariance as prior.

    A point's residual is its height over the plane through the map's cells around it [1]_; rocks and what moved are
    weighed down [2]_. Flat ground fixes height and tilt and leaves east, north and heading to the prior.
    """

    Config: ClassVar[type[DfnConfig]] = TangentPlanesConfig

    def setup(self) -> None:
        """Compile, so that the first capture is as fast as the others."""
        heights = np.zeros((5, 5), np.float32)
        heights.setflags(write=False)  # layers of a message cannot be written to: another type to the compiler
        self._over(np.zeros((1, 3)), heights, (0.1, 0.0, 0.5))

    def process(self, inputs: DemRegistrationInputs) -> DemRegistrationOutputs:
        """Return the correction; raises InputError on arrays that do not fit or a covariance that is none."""
        c = self.config
        given = checked_points(inputs.points, least=0)
        noise = np.asarray(inputs.noise_variance, dtype=np.float64)
        prior = np.asarray(inputs.covariance, dtype=np.float64)
        if noise.shape != (len(given),):
            raise InputError(f"{len(given)} points, noise_variance {noise.shape}: expected one of each")
        if prior.shape != (6, 6) or not np.all(np.isfinite(prior)) or np.linalg.eigvalsh(prior)[0] < -1e-9:
            raise InputError("covariance: expected a positive semi-definite 6x6 matrix")
        nothing = DemRegistrationOutputs(correction=np.eye(4), covariance=prior, matched=np.array(0))
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
            if matched < c.min_points or matched < c.min_overlap * len(points):
                return nothing
            r, g = above[on], gradient[on]
            variance = noise[on] * (1.0 + (g**2).sum(axis=1)) + spread[on] + self._of_map(inputs.map, moved[on])
            scale = max(1.4826 * float(np.median(np.abs(r) / np.sqrt(variance))), 1.0)
            u = r / (_BIWEIGHT * scale * np.sqrt(variance))
            weight = np.where(np.abs(u) < 1.0, (1.0 - u**2) ** 2, 0.0) / (variance * scale**2)
            J = _jacobian(moved[on] - inputs.centre, g)
            JW = J * weight[:, None]
            fitted = information + JW.T @ J / c.inflation
            update = np.linalg.solve(fitted, -(JW.T @ r) / c.inflation - information @ d)
            d = d + update
            if np.abs(update).max() < 1e-6:
                break
        if d @ information @ d > c.max_chi2:
            return nothing
        return DemRegistrationOutputs(
            correction=_about(inputs.centre, d), covariance=np.linalg.inv(fitted), matched=np.array(matched)
        )

    def _of_map(self, dem: ElevationMap, points: Array) -> Array:
        """Variance of the map's height at each point that the scatter of its cells does not show, square metres."""
        least = np.full(len(points), self.config.map_sigma_m**2)
        if "error_variance" not in dem.layer_names:
            return least
        row, col, inside = dem.geometry.cells_of(points[:, 0], points[:, 1])
        error = dem.layer("error_variance") - dem.layer("pose_variance")
        least[inside] += np.nan_to_num(error[row[inside], col[inside]])
        return least

    def _over(
        self, points: Array, heights: NDArray[np.float32], grid: tuple[float, float, float]
    ) -> tuple[Array, Array, Array]:
        from cdff_core.dfns.dem_registration._kernels import tangent_planes

        above, gradient, spread = np.empty(len(points)), np.empty((len(points), 2)), np.empty(len(points))
        tangent_planes(points, heights, *grid, self.config.radius_cells, above, gradient, spread)
        return above, gradient, spread


def _grid(dem: ElevationMap) -> tuple[float, float, float]:
    g = dem.geometry
    return g.resolution_m, g.xmin_m, g.ymax_m


def _about(centre: Array, d: Array) -> Array:
    """Transform that moves by ``d[:3]`` and turns by ``d[3:]`` about a point."""
    R = se3.exp_so3(d[3:])
    return np.asarray(se3.transform(R, centre + d[:3] - R @ centre))


def _jacobian(arm: Array, gradient: Array) -> Array:
    """Derivative of the heights over the planes by translation and rotation, shape (n, 6)."""
    normal = np.column_stack([-gradient, np.ones(len(gradient))])
    return np.hstack([normal, np.cross(arm, normal)])

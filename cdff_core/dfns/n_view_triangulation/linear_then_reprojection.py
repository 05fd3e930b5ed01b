# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Triangulation from all views: linear initial value, then minimisation of the reprojection error."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.camera import CameraModel
from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import BundleProblem
from cdff_core.dfns.n_view_triangulation._kernels import triangulate
from cdff_core.dfns.n_view_triangulation.interface import Inputs, Interface, Outputs

_REASONS = ("found", "few_views", "degenerate", "behind", "small_angle", "large_residual")


class LinearThenReprojectionConfig(DfnConfig):
    """Parameters of LinearThenReprojection."""

    sigma_px: float = Field(0.5, gt=0, le=100, description="Standard deviation of an observed column or row")
    max_iterations: int = Field(10, ge=0, le=100, description="Maximum number of Gauss-Newton steps")
    min_angle_deg: float = Field(
        0.2, ge=0, le=90, description="Minimum of the widest angle between the rays of a valid point"
    )
    max_residual_px: float = Field(
        4.0, gt=0, le=1000, description="Largest root mean square reprojection error"
    )
    min_depth_m: float = Field(1e-6, ge=0, description="Depth below which a point is removed")


class LinearThenReprojection(Interface[LinearThenReprojectionConfig]):
    """Least squares on the cross products [1]_, weighted by depth, then Gauss-Newton on the reprojection
    error.

    For two views the minimum equals that of optimal triangulation in closed form [2]_; for more views it is
    the maximum-likelihood point under equal Gaussian noise. The covariance follows from the last normal
    matrix, multiplied by the variance of unit weight if that is above 1.

    References
    ----------
    .. [1] R. Hartley, P. Sturm, Triangulation, CVIU 68(2), 1997, doi:10.1006/cviu.1997.0547
    .. [2] P. Lindstrom, Triangulation made easy, CVPR 2010, doi:10.1109/CVPR.2010.5539785
    """

    def setup(self) -> None:
        """Compile the kernel."""
        start, cam, xy = np.array([0, 2]), np.array([0, 1]), np.array([[0.0, 0.0], [-0.1, 0.0]])
        P = np.stack([np.eye(4)[:3], np.eye(4)[:3]])
        P[1, 0, 3] = -1.0
        triangulate(start, cam, xy, P, -P[:, :, 3], np.ones((2, 2)), 2, 1.0, 1.0, 0.0)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the triangulated points; raises InputError and RefusedError."""
        c, tracks = self.config, inputs.tracks
        if not len(tracks.cameras.ids):
            raise InputError("tracks: no cameras")
        start, order = _group_by_point(tracks)
        cam = tracks.observations.cameras[order].astype(np.int64)
        xy = np.ascontiguousarray(_undistort(tracks)[order])
        focal = np.ascontiguousarray(tracks.lenses.values[tracks.cameras.lenses, :2])
        T = np.linalg.inv(tracks.cameras.matrices)
        points, inverse, costs, angles, status = triangulate(
            start,
            cam,
            xy,
            np.ascontiguousarray(T[:, :3]),
            tracks.cameras.poses[:, :3].copy(),
            focal,
            c.max_iterations,
            float(np.cos(np.radians(c.min_angle_deg))),
            c.max_residual_px,
            c.min_depth_m,
        )
        valid, views = status == 0, np.diff(start)
        self.metrics = {name: float((status == code).sum()) for code, name in enumerate(_REASONS)}
        if not valid.any():
            main_reason = max(_REASONS[1:], key=lambda name: self.metrics[name])
            raise RefusedError(
                f"none of {len(points)} points is valid", ["no_points", f"mostly:{main_reason}"]
            )
        freedom = int((2 * views[valid] - 3).sum())
        variance = float(costs[valid].sum()) / freedom / c.sigma_px**2 if freedom > 0 else 1.0
        return Outputs(
            points=points,
            covariances=inverse * (c.sigma_px**2 * max(variance, 1.0)),
            valid=valid,
            status=status,
            angles=angles,
            rms_px=np.sqrt(costs / np.maximum(views, 1)),
            unit_variance=variance,
        )


def _undistort(tracks: BundleProblem) -> FloatArray:
    """Return undistorted observations ``(m, 2)`` on the plane z = 1; raises InputError."""
    values, pixels = tracks.lenses.values, tracks.observations.pixels[:, :2]
    lens = tracks.cameras.lenses[tracks.observations.cameras]
    lens_rows = np.unique(lens)
    invalid = lens_rows[~(values[lens_rows, :2] > 0.0).all(axis=1)]
    if len(invalid):
        raise InputError(f"lens {invalid[0]}: focal lengths {values[invalid[0], :2]} px, expected above 0")
    if len(lens_rows) == 1:
        undistorted = pixels - values[lens_rows[0], 2:4]
        undistorted /= values[lens_rows[0], :2]
    else:
        undistorted = (pixels - values[lens, 2:4]) / values[lens, :2]
    for row in lens_rows:
        if values[row, 4:9].any():
            fx, fy, cx, cy, *distortion = values[row, :9]
            camera = CameraModel.from_matrix([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], distortion)
            is_of_lens = lens == row
            rays = camera.rays(pixels[is_of_lens])
            undistorted[is_of_lens] = rays[:, :2] / rays[:, 2:]
    return undistorted


def _group_by_point(tracks: BundleProblem) -> tuple[IntArray, IntArray | slice]:
    """Return the row of the first observation of each point after sorting by point, and the order."""
    rows = tracks.observations.points.astype(np.int64)
    order = slice(None) if (rows[1:] >= rows[:-1]).all() else np.argsort(rows, kind="stable")
    counts = np.bincount(rows, minlength=len(tracks.points.ids))
    return np.r_[0, np.cumsum(counts)].astype(np.int64), order

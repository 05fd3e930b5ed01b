# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""LinearThenReprojection: all views at once, linear first, then the least reprojection error."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.camera import CameraModel
from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import BundleProblem
from cdff_core.dfns.n_view_triangulation._interface import (
    NViewTriangulationInputs,
    NViewTriangulationInterface,
    NViewTriangulationOutputs,
)
from cdff_core.dfns.n_view_triangulation._kernels import triangulated

Float = NDArray[np.float64]
_REASONS = ("found", "few_views", "degenerate", "behind", "small_angle", "large_residual")


class LinearThenReprojectionConfig(DfnConfig):
    """Noise and gates."""

    sigma_px: Annotated[float, Field(gt=0, le=100)] = 0.5
    max_iterations: Annotated[int, Field(ge=0, le=100)] = 10
    min_angle_deg: Annotated[float, Field(ge=0, le=90)] = 0.2
    max_residual_px: Annotated[float, Field(gt=0, le=1000)] = 4.0
    min_depth_m: Annotated[float, Field(ge=0)] = 1e-6
    scale_by_residuals: bool = True


class LinearThenReprojection(NViewTriangulationInterface):
    """Least squares on the cross products [1]_, weighed by depth, then Gauss-Newton on the reprojection error.

    For two views the minimum is the one that optimal triangulation has in closed form [2]_; for more it is the
    maximum-likelihood point under equal Gaussian noise. One pass over the points, compiled; the covariance is that of
    the last normal matrix.

    References
    ----------
    .. [1] R. Hartley, P. Sturm, Triangulation, CVIU 68(2), 1997, doi:10.1006/cviu.1997.0547
    .. [2] P. Lindstrom, Triangulation made easy, CVPR 2010, doi:10.1109/CVPR.2010.5539785
    """

    Config = LinearThenReprojectionConfig
    config: LinearThenReprojectionConfig

    def setup(self) -> None:
        """Compile the kernel."""
        start, cam, xy = np.array([0, 2]), np.array([0, 1]), np.array([[0.0, 0.0], [-0.1, 0.0]])
        P = np.stack([np.eye(4)[:3], np.eye(4)[:3]])
        P[1, 0, 3] = -1.0
        triangulated(start, cam, xy, P, -P[:, :, 3], np.ones((2, 2)), 2, 1.0, 1.0, 0.0)

    def process(self, inputs: NViewTriangulationInputs) -> NViewTriangulationOutputs:
        """Triangulate every point; raises InputError and RefusedError."""
        c, tracks = self.config, inputs.tracks
        if not len(tracks.cameras.ids):
            raise InputError("tracks: no cameras")
        start, order = _by_point(tracks)
        cam = tracks.observations.cameras[order].astype(np.int64)
        xy = np.ascontiguousarray(normalised(tracks)[order])
        focal = np.ascontiguousarray(tracks.lenses.values[tracks.cameras.lenses, :2])
        T = np.linalg.inv(tracks.cameras.matrices)
        points, inverse, costs, angles, status = triangulated(
            start, cam, xy, np.ascontiguousarray(T[:, :3]), tracks.cameras.poses[:, :3].copy(), focal, c.max_iterations,
            float(np.cos(np.radians(c.min_angle_deg))), c.max_residual_px, c.min_depth_m,
        )  # fmt: skip
        valid, views = status == 0, np.diff(start)
        self.metrics = {name: float((status == code).sum()) for code, name in enumerate(_REASONS)}
        if not valid.any():
            worst = max(_REASONS[1:], key=lambda name: self.metrics[name])
            raise RefusedError(f"none of {len(points)} points can be stood for", ["no_points", f"mostly:{worst}"])
        freedom = int((2 * views[valid] - 3).sum())
        variance = float(costs[valid].sum()) / freedom / c.sigma_px**2 if freedom > 0 else 1.0
        scale = c.sigma_px**2 * (max(variance, 1.0) if c.scale_by_residuals else 1.0)
        return NViewTriangulationOutputs(
            points, inverse * scale, valid, status, angles, np.sqrt(costs / np.maximum(views, 1)), np.array(variance)
        )


def normalised(tracks: BundleProblem) -> Float:
    """Observations ``(m, 2)`` on the plane z = 1, their lenses' distortion taken out; raises InputError."""
    values, pixels = tracks.lenses.values, tracks.observations.pixels[:, :2]
    lens = tracks.cameras.lenses[tracks.observations.cameras]
    used = np.unique(lens)
    if len(used) and not (values[used, :2] > 0.0).all():
        raise InputError(f"lens {used[0]}: focal lengths {values[used[0], :2]} px, expected above 0")
    if len(used) == 1:
        out = pixels - values[used[0], 2:4]
        out /= values[used[0], :2]
    else:
        out = (pixels - values[lens, 2:4]) / values[lens, :2]
    for row in used:
        if values[row, 4:9].any():
            fx, fy, cx, cy, *distortion = values[row, :9]
            camera = CameraModel.from_matrix([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], distortion)
            here = lens == row
            rays = camera.rays(pixels[here])
            out[here] = rays[:, :2] / rays[:, 2:]
    return out


def _by_point(tracks: BundleProblem) -> tuple[NDArray[np.int64], NDArray[np.int64] | slice]:
    """Where the observations of each point begin, and the order that brings them together."""
    rows = tracks.observations.points.astype(np.int64)
    order = slice(None) if (rows[1:] >= rows[:-1]).all() else np.argsort(rows, kind="stable")
    counts = np.bincount(rows, minlength=len(tracks.points.ids))
    return np.r_[0, np.cumsum(counts)].astype(np.int64), order

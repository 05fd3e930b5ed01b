# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Exhaustive comparison of a scan with all positions and headings on a height map."""

from __future__ import annotations

import numpy as np
from pydantic import Field
from scipy.ndimage import uniform_filter

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.levelling import rotations_to_z
from cdff_common.geometry.points import checked_points
from cdff_common.geometry.robust import median_sigma
from cdff_common.geometry.voxels import voxel_means
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.place_search._kernels import residuals
from cdff_core.dfns.place_search.interface import Inputs, Interface, Outputs

#: Minimum number of points of the ground below the robot, and number of fits of its plane.
_MIN_GROUND_POINTS, _PLANE_FITS = 30, 4
#: Angle between tested headings.
_HEADING_STEP_DEG = 10.0
#: Minimum fraction of scan points over the map.
_MIN_COVERED = 0.5


class ElevationCorrelationConfig(DfnConfig):
    """Parameters of ElevationCorrelation."""

    cell_m: float = Field(0.5, gt=0, le=10, description="Edge of the cells whose heights are compared")
    step_m: float = Field(1.5, gt=0, le=100, description="Distance between tested positions")
    range_m: float = Field(18.0, gt=1, le=200, description="Largest range of the scan points used")
    foot_m: float = Field(
        6.0,
        gt=0.5,
        le=20,
        description="Radius within which the tilt and height of the ground below the robot are estimated",
    )
    points: int = Field(300, ge=50, le=10_000, description="Number of scan points compared")
    cutoff_m: float = Field(
        0.5, gt=0, le=10, description="Height difference above which the cost is constant"
    )
    candidates: int = Field(6, ge=1, le=200, description="Maximum number of candidates")


class ElevationCorrelation(Interface[ElevationCorrelationConfig]):
    """Compare the scan with the map at all positions and headings; tilt and height follow from the ground of
    the map.

    Notes
    -----
    The search is exhaustive because distinctive features are scarce on planetary terrain (Carle et al. 2010,
    doi:10.1002/rob.20319, match rover scans with orbital elevation models). The results are coarse and must
    be refined by registration.
    """

    def setup(self) -> None:
        """Compile the kernel."""
        residuals(
            np.zeros((2, 2)), np.zeros(2), 1.0, np.eye(4)[None], np.eye(2)[:1], np.zeros((1, 3)), 1.0, 0.5
        )

    def process(self, inputs: Inputs) -> Outputs:
        """Return the candidates; raises InputError, or RefusedError if the sweep contains no ground."""
        cfg = self.config
        map_points = checked_points(inputs.map_points, "map_points", 1)
        sweep = checked_points(inputs.sweep_points, "sweep_points", _MIN_GROUND_POINTS)
        T_foot_robot = _locate_foot(sweep, cfg.foot_m)
        near_points = sweep[np.linalg.norm(sweep, axis=1) <= cfg.range_m]
        # The density is made even, so that the dense rings around the robot do not outweigh distant points.
        thinned_points = voxel_means(se3.transform_points(T_foot_robot, near_points), 2.0 * cfg.cell_m)
        points = thinned_points[np.random.default_rng(0).permutation(len(thinned_points))[: cfg.points]]
        heights, origin = _rasterise(map_points, cfg.cell_m)
        starts = self._starts(heights, origin)
        rotations = np.radians(np.arange(0.0, 360.0, _HEADING_STEP_DEG))
        cosine_sine = np.column_stack([np.cos(rotations), np.sin(rotations)])
        cost = residuals(heights, origin, cfg.cell_m, starts, cosine_sine, points, cfg.cutoff_m, _MIN_COVERED)
        best = self._separated_minima(cost, starts, rotations)
        heading = se3.exp_so3(np.column_stack([np.zeros((len(best), 2)), rotations[best[:, 1]]]))
        poses = starts[best[:, 0]] @ se3.transform(heading, np.zeros(3)) @ T_foot_robot
        return Outputs(transforms=poses, residuals_m=cost[best[:, 0], best[:, 1]], searched=cost.size)

    def _starts(self, heights: FloatArray, origin: FloatArray) -> FloatArray:
        """Return T_map_foot ``(s, 4, 4)`` of positions a step apart where the map has heights."""
        cfg = self.config
        width = 2 * max(1, round(0.5 * cfg.foot_m / cfg.cell_m)) + 1
        is_known = np.isfinite(heights)
        known_fraction = uniform_filter(is_known.astype(np.float64), width, mode="constant")
        smooth = uniform_filter(np.where(is_known, heights, 0.0), width, mode="constant")
        smooth /= np.maximum(known_fraction, 1e-9)
        slope = (
            np.stack(np.gradient(smooth, cfg.cell_m), axis=-1)
            if min(smooth.shape) > 1
            else np.zeros((1, 1, 2))
        )
        stride = max(1, round(cfg.step_m / cfg.cell_m))
        rows, columns = (
            g.ravel()
            for g in np.meshgrid(
                np.arange(stride // 2, heights.shape[0], stride),
                np.arange(stride // 2, heights.shape[1], stride),
                indexing="ij",
            )
        )
        is_covered = known_fraction[rows, columns] > 0.5
        rows, columns = rows[is_covered], columns[is_covered]
        gradient = slope[rows, columns]
        normal = np.column_stack([-gradient, np.ones(len(rows))])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        position = np.column_stack(
            [origin + cfg.cell_m * (np.column_stack([rows, columns]) + 0.5), smooth[rows, columns]]
        )
        return se3.transform(np.swapaxes(rotations_to_z(normal), 1, 2), position)

    def _separated_minima(self, cost: FloatArray, starts: FloatArray, rotations: FloatArray) -> IntArray:
        """Return rows and columns ``(k, 2)`` of the smallest costs that are not adjacent to a smaller one,
        best first.
        """
        cfg = self.config
        order = np.argsort(cost, axis=None)[: 50 * cfg.candidates]
        minima: list[tuple[int, int]] = []
        for flat in order:
            s, t = divmod(int(flat), len(rotations))
            if not np.isfinite(cost[s, t]) or len(minima) == cfg.candidates:
                break
            is_adjacent = any(
                np.linalg.norm(starts[s, :2, 3] - starts[a, :2, 3]) < 1.6 * cfg.step_m
                and abs(np.remainder(rotations[t] - rotations[b] + np.pi, 2 * np.pi) - np.pi)
                < 1.6 * np.radians(_HEADING_STEP_DEG)
                for a, b in minima
            )
            if not is_adjacent:
                minima.append((s, t))
        return np.array(minima, dtype=np.int64).reshape(-1, 2)


def _locate_foot(sweep: FloatArray, foot_m: float) -> FloatArray:
    """Return T_foot_robot; the foot is the frame on the ground below the robot, z along the normal of the
    ground.

    Raises
    ------
    RefusedError
        If too few points lie within twice ``foot_m``.
    """
    distance_m = np.linalg.norm(sweep[:, :2], axis=1)
    near_ground = next(
        (
            sweep[distance_m < radius_m]
            for radius_m in (foot_m, 2.0 * foot_m)
            if np.count_nonzero(distance_m < radius_m) >= _MIN_GROUND_POINTS
        ),
        None,
    )
    if near_ground is None:
        raise RefusedError(
            f"fewer than {_MIN_GROUND_POINTS} points within {2 * foot_m:g} m of the robot", ["no_ground"]
        )
    # The plane is fitted repeatedly, each time without the points that lie above or below the previous one.
    ground = near_ground
    for _ in range(_PLANE_FITS):
        A = np.column_stack([ground[:, :2], np.ones(len(ground))])
        plane = np.linalg.lstsq(A, ground[:, 2], rcond=None)[0]
        residual_m = near_ground[:, 2] - near_ground[:, :2] @ plane[:2] - plane[2]
        limit_m = 2.0 * max(median_sigma(residual_m), 1e-3)
        ground = near_ground[np.abs(residual_m) < limit_m]
    normal = np.array([-plane[0], -plane[1], 1.0]) / np.sqrt(plane[0] ** 2 + plane[1] ** 2 + 1.0)
    R = rotations_to_z(normal[None])[0]
    return se3.transform(R, [0.0, 0.0, -normal[2] * plane[2]])


def _rasterise(points: FloatArray, cell_m: float) -> tuple[FloatArray, FloatArray]:
    """Return the mean height of each cell, shape (cells along x, cells along y), and the origin (2,), metres.

    Empty cells are NaN. The origin is the corner of the grid with the smallest x and y.
    """
    origin = np.floor(points[:, :2].min(axis=0) / cell_m) * cell_m
    index = np.floor((points[:, :2] - origin) / cell_m).astype(np.int64)
    shape = tuple(index.max(axis=0) + 1)
    flat = np.ravel_multi_index((index[:, 0], index[:, 1]), shape)
    count = np.bincount(flat, minlength=shape[0] * shape[1])
    total = np.bincount(flat, weights=points[:, 2], minlength=shape[0] * shape[1])
    with np.errstate(invalid="ignore"):
        return (total / count).reshape(shape), origin

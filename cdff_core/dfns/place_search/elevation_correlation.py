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

_LEAST_FOOT = 30
_PLANE_ROUNDS = 4
#: Angle between tested headings, which registration refines.
_HEADING_STEP_DEG = 10.0
#: Minimum fraction of scan points over the map.
_LEAST_COVERED = 0.5


class ElevationCorrelationConfig(DfnConfig):
    """Parameters of ElevationCorrelation."""

    cell_m: float = Field(0.5, gt=0, le=10, description="Edge of the cells whose heights are compared")
    step_m: float = Field(1.5, gt=0, le=100, description="Distance between tested positions")
    range_m: float = Field(18.0, gt=1, le=200, description="Largest range of the scan points used")
    foot_m: float = Field(
        6.0, gt=0.5, le=20, description="Radius of the ground below the robot in scan and map"
    )
    points: int = Field(300, ge=50, le=10_000, description="Number of scan points compared")
    cutoff_m: float = Field(
        0.5, gt=0, le=10, description="Height difference above which the cost is constant"
    )
    candidates: int = Field(6, ge=1, le=200, description="Maximum number of candidates")


class ElevationCorrelation(Interface[ElevationCorrelationConfig]):
    """Search over position and heading; tilt and height of the robot follow from the ground of the map.

    Notes
    -----
    Exhaustive, as planetary rovers are matched with orbital elevation models (Carle et al. 2010,
    doi:10.1002/rob.20319, discuss why features are scarce there). The results are coarse and must be refined
    by registration.
    """

    def setup(self) -> None:
        """Compile the kernel."""
        residuals(
            np.zeros((2, 2)), np.zeros(2), 1.0, np.eye(4)[None], np.eye(2)[:1], np.zeros((1, 3)), 1.0, 0.5
        )

    def process(self, inputs: Inputs) -> Outputs:
        """Return candidates; raises InputError, or RefusedError where the scan contains no ground."""
        cfg = self.config
        ground = checked_points(inputs.map, "map", 1)
        scan = checked_points(inputs.scan, "scan", _LEAST_FOOT)
        T_foot_robot = foot(scan, cfg.foot_m)
        near = scan[np.linalg.norm(scan, axis=1) <= cfg.range_m]
        # Evenly over the area, so that the dense rings around the robot do not dominate farther points.
        spread = voxel_means(se3.transform_points(T_foot_robot, near), 2.0 * cfg.cell_m)
        points = spread[np.random.default_rng(0).permutation(len(spread))[: cfg.points]]
        heights, origin = raster(ground, cfg.cell_m)
        starts = self._starts(heights, origin)
        rotations = np.radians(np.arange(0.0, 360.0, _HEADING_STEP_DEG))
        both = np.column_stack([np.cos(rotations), np.sin(rotations)])
        cost = residuals(heights, origin, cfg.cell_m, starts, both, points, cfg.cutoff_m, _LEAST_COVERED)
        chosen = self._apart(cost, starts, rotations)
        spun = se3.exp_so3(np.column_stack([np.zeros((len(chosen), 2)), rotations[chosen[:, 1]]]))
        poses = starts[chosen[:, 0]] @ se3.transform(spun, np.zeros(3)) @ T_foot_robot
        return Outputs(transforms=poses, residuals_m=cost[chosen[:, 0], chosen[:, 1]], searched=cost.size)

    def _starts(self, heights: FloatArray, origin: FloatArray) -> FloatArray:
        """Return poses ``(s, 4, 4)`` of the ground, a step apart, where the map covers it."""
        cfg = self.config
        width = 2 * max(1, round(0.5 * cfg.foot_m / cfg.cell_m)) + 1
        known = np.isfinite(heights)
        share = uniform_filter(known.astype(np.float64), width, mode="constant")
        smooth = uniform_filter(np.where(known, heights, 0.0), width, mode="constant") / np.maximum(
            share, 1e-9
        )
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
        kept = share[rows, columns] > 0.5
        rows, columns = rows[kept], columns[kept]
        gradient = slope[rows, columns]
        normal = np.column_stack([-gradient, np.ones(len(rows))])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        place = np.column_stack(
            [origin + cfg.cell_m * (np.column_stack([rows, columns]) + 0.5), smooth[rows, columns]]
        )
        return se3.transform(np.swapaxes(rotations_to_z(normal), 1, 2), place)

    def _apart(self, cost: FloatArray, starts: FloatArray, rotations: FloatArray) -> IntArray:
        """Return rows and columns ``(k, 2)`` of the smallest costs that are not adjacent to a smaller one."""
        cfg = self.config
        order = np.argsort(cost, axis=None)[: 50 * cfg.candidates]
        chosen: list[tuple[int, int]] = []
        for flat in order:
            s, t = divmod(int(flat), len(rotations))
            if not np.isfinite(cost[s, t]) or len(chosen) == cfg.candidates:
                break
            beside = any(
                np.linalg.norm(starts[s, :2, 3] - starts[a, :2, 3]) < 1.6 * cfg.step_m
                and abs(np.remainder(rotations[t] - rotations[b] + np.pi, 2 * np.pi) - np.pi)
                < 1.6 * np.radians(_HEADING_STEP_DEG)
                for a, b in chosen
            )
            if not beside:
                chosen.append((s, t))
        return np.array(chosen, dtype=np.int64).reshape(-1, 2)


def foot(scan: FloatArray, foot_m: float) -> FloatArray:
    """``T_foot_robot``: z along the ground's normal below the robot, origin on the ground.

    Raises
    ------
    RefusedError
        If too few points lie within ``foot_m``, in twice that either.
    """
    flat = np.linalg.norm(scan[:, :2], axis=1)
    near = next(
        (scan[flat < r] for r in (foot_m, 2.0 * foot_m) if np.count_nonzero(flat < r) >= _LEAST_FOOT), None
    )
    if near is None:
        raise RefusedError(
            f"fewer than {_LEAST_FOOT} points within {2 * foot_m:g} m of the robot", ["no_ground"]
        )
    # The plane is fitted again without the points above the ground.
    kept = near
    for _ in range(_PLANE_ROUNDS):
        A = np.column_stack([kept[:, :2], np.ones(len(kept))])
        plane = np.linalg.lstsq(A, kept[:, 2], rcond=None)[0]
        off = near[:, 2] - near[:, :2] @ plane[:2] - plane[2]
        width = 2.0 * max(median_sigma(off), 1e-3)
        kept = near[np.abs(off) < width]
    normal = np.array([-plane[0], -plane[1], 1.0]) / np.sqrt(plane[0] ** 2 + plane[1] ** 2 + 1.0)
    R = rotations_to_z(normal[None])[0]
    return se3.transform(R, [0.0, 0.0, -normal[2] * plane[2]])


def raster(points: FloatArray, cell_m: float) -> tuple[FloatArray, FloatArray]:
    """Return the mean height of each cell, shape (cells along x, cells along y), metres, and a corner.

    Empty cells are NaN. The corner ``(2,)`` is that of the first cell with the smallest x and y, metres.
    """
    origin = np.floor(points[:, :2].min(axis=0) / cell_m) * cell_m
    index = np.floor((points[:, :2] - origin) / cell_m).astype(np.int64)
    shape = tuple(index.max(axis=0) + 1)
    flat = np.ravel_multi_index((index[:, 0], index[:, 1]), shape)
    count = np.bincount(flat, minlength=shape[0] * shape[1])
    total = np.bincount(flat, weights=points[:, 2], minlength=shape[0] * shape[1])
    with np.errstate(invalid="ignore"):
        return (total / count).reshape(shape), origin

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Try a scan at every place and heading of a map of heights."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.ndimage import uniform_filter

from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_common.geometry.points import checked_points
from cdff_common.geometry.voxels import voxel_means
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.place_search._interface import PlaceSearchInputs, PlaceSearchInterface, PlaceSearchOutputs

Float = NDArray[np.float64]

_LEAST_FOOT = 30
_PLANE_ROUNDS = 4


class ElevationCorrelationConfig(DfnConfig):
    """How finely the map is searched, and what is compared."""

    cell_m: float = Field(0.5, gt=0.0, le=10.0, description="Cell of the heights, metres")
    step_m: float = Field(1.5, gt=0.0, le=100.0, description="Distance of the places tried, metres")
    heading_step_deg: float = Field(10.0, gt=0.5, le=90.0, description="Distance of the headings tried, degrees")
    range_m: float = Field(18.0, gt=1.0, le=200.0, description="Scan points used lie within, metres")
    foot_m: float = Field(6.0, gt=0.5, le=20.0, description="How the ground lies is told by what is within, metres")
    points: int = Field(300, ge=50, le=10_000, description="Scan points compared")
    cutoff_m: float = Field(0.5, gt=0.0, le=10.0, description="Height difference that counts no more, metres")
    least_covered: float = Field(0.5, gt=0.0, le=1.0, description="Share of the scan points over the map")
    candidates: int = Field(6, ge=1, le=200, description="Candidates at most")


class ElevationCorrelation(PlaceSearchInterface):
    """A robot stands on the ground: place and heading say all, tilt and height follow from the map.

    Notes
    -----
    Exhaustive, as planetary rovers are matched with orbital elevation models (Carle et al. 2010,
    doi:10.1002/rob.20319, discuss why features are scarce there). What is returned is coarse: a registration decides.
    """

    Config: ClassVar[type[DfnConfig]] = ElevationCorrelationConfig

    def setup(self) -> None:
        """Compile the comparison."""
        from cdff_core.dfns.place_search._kernels import residuals

        residuals(np.zeros((2, 2)), np.zeros(2), 1.0, np.eye(4)[None], np.eye(2)[:1], np.zeros((1, 3)), 1.0, 0.5)

    def process(self, inputs: PlaceSearchInputs) -> PlaceSearchOutputs:
        """Return candidates; raises InputError, or RefusedError where the scan shows no ground."""
        from cdff_core.dfns.place_search._kernels import residuals

        cfg: Any = self.config
        ground = checked_points(inputs.map, "map", 1)
        scan = checked_points(inputs.scan, "scan", _LEAST_FOOT)
        T_foot_robot = foot(scan, cfg.foot_m)
        near = scan[np.linalg.norm(scan, axis=1) <= cfg.range_m]
        # Evenly over the area, so that the dense rings around the robot do not outvote what is farther away.
        spread = voxel_means(se3.transform_points(T_foot_robot, near), 2.0 * cfg.cell_m)
        points = spread[np.random.default_rng(0).permutation(len(spread))[: cfg.points]]
        heights, origin = raster(ground, cfg.cell_m)
        starts = self._starts(heights, origin)
        turns = np.radians(np.arange(0.0, 360.0, cfg.heading_step_deg))
        both = np.column_stack([np.cos(turns), np.sin(turns)])
        cost = residuals(heights, origin, cfg.cell_m, starts, both, points, cfg.cutoff_m, cfg.least_covered)
        chosen = self._apart(cost, starts, turns)
        spun = se3.exp_so3(np.column_stack([np.zeros((len(chosen), 2)), turns[chosen[:, 1]]]))
        poses = starts[chosen[:, 0]] @ se3.transform(spun, np.zeros(3)) @ T_foot_robot
        return PlaceSearchOutputs(poses, cost[chosen[:, 0], chosen[:, 1]], np.array(cost.size))

    def _starts(self, heights: Float, origin: Float) -> Float:
        """Poses ``(s, 4, 4)`` of the ground, a step apart, where the map covers what is below a robot."""
        cfg: Any = self.config
        width = 2 * max(1, round(0.5 * cfg.foot_m / cfg.cell_m)) + 1
        known = np.isfinite(heights)
        share = uniform_filter(known.astype(np.float64), width, mode="constant")
        smooth = uniform_filter(np.where(known, heights, 0.0), width, mode="constant") / np.maximum(share, 1e-9)
        slope = np.stack(np.gradient(smooth, cfg.cell_m), axis=-1) if min(smooth.shape) > 1 else np.zeros((1, 1, 2))
        stride = max(1, round(cfg.step_m / cfg.cell_m))
        rows, columns = (g.ravel() for g in np.meshgrid(
            np.arange(stride // 2, heights.shape[0], stride), np.arange(stride // 2, heights.shape[1], stride),
            indexing="ij"))  # fmt: skip
        kept = share[rows, columns] > 0.5
        rows, columns = rows[kept], columns[kept]
        gradient = slope[rows, columns]
        normal = np.column_stack([-gradient, np.ones(len(rows))])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        place = np.column_stack([origin + cfg.cell_m * (np.column_stack([rows, columns]) + 0.5), smooth[rows, columns]])
        return se3.transform(np.swapaxes(_upright(normal), 1, 2), place)

    def _apart(self, cost: Float, starts: Float, turns: Float) -> NDArray[np.int64]:
        """Rows and columns ``(k, 2)`` of the least costs, none beside a lesser one."""
        cfg: Any = self.config
        order = np.argsort(cost, axis=None)[: 50 * cfg.candidates]
        chosen: list[tuple[int, int]] = []
        for flat in order:
            s, t = divmod(int(flat), len(turns))
            if not np.isfinite(cost[s, t]) or len(chosen) == cfg.candidates:
                break
            beside = any(
                np.linalg.norm(starts[s, :2, 3] - starts[a, :2, 3]) < 1.6 * cfg.step_m
                and abs(np.remainder(turns[t] - turns[b] + np.pi, 2 * np.pi) - np.pi)
                < 1.6 * np.radians(cfg.heading_step_deg)
                for a, b in chosen
            )
            if not beside:
                chosen.append((s, t))
        return np.array(chosen, dtype=np.int64).reshape(-1, 2)


def foot(scan: Float, foot_m: float) -> Float:
    """``T_foot_robot``: z along the ground's normal below the robot, origin on the ground.

    Raises
    ------
    RefusedError
        If too few points lie within ``foot_m``, in twice that either.
    """
    flat = np.linalg.norm(scan[:, :2], axis=1)
    near = next((scan[flat < r] for r in (foot_m, 2.0 * foot_m) if np.count_nonzero(flat < r) >= _LEAST_FOOT), None)
    if near is None:
        raise RefusedError(f"fewer than {_LEAST_FOOT} points within {2 * foot_m:g} m of the robot", ["no_ground"])
    # What rises above the ground is no ground: the plane is fitted again without it.
    kept = near
    for _ in range(_PLANE_ROUNDS):
        A = np.column_stack([kept[:, :2], np.ones(len(kept))])
        plane = np.linalg.lstsq(A, kept[:, 2], rcond=None)[0]
        off = near[:, 2] - near[:, :2] @ plane[:2] - plane[2]
        width = 2.0 * max(1.4826 * float(np.median(np.abs(off))), 1e-3)
        kept = near[np.abs(off) < width]
    normal = np.array([-plane[0], -plane[1], 1.0]) / np.sqrt(plane[0] ** 2 + plane[1] ** 2 + 1.0)
    R = _upright(normal[None])[0]
    return se3.transform(R, [0.0, 0.0, -normal[2] * plane[2]])


def _upright(normals: Float) -> Float:
    """Least rotations ``(n, 3, 3)`` that turn unit normals ``(n, 3)`` to z."""
    axis = np.column_stack([normals[:, 1], -normals[:, 0], np.zeros(len(normals))])
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    angle = np.arctan2(sine, normals[:, 2:])
    return se3.exp_so3(axis / np.maximum(sine, 1e-12) * angle)


def raster(points: Float, cell_m: float) -> tuple[Float, Float]:
    """Mean heights of cells along x and y, NaN where there is no point, and the corner ``(2,)`` of the first one."""
    origin = np.floor(points[:, :2].min(axis=0) / cell_m) * cell_m
    index = np.floor((points[:, :2] - origin) / cell_m).astype(np.int64)
    shape = tuple(index.max(axis=0) + 1)
    flat = np.ravel_multi_index((index[:, 0], index[:, 1]), shape)
    count = np.bincount(flat, minlength=shape[0] * shape[1])
    total = np.bincount(flat, weights=points[:, 2], minlength=shape[0] * shape[1])
    with np.errstate(invalid="ignore"):
        return (total / count).reshape(shape), origin

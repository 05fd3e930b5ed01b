# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Hypotheses of the pose of a model in a scan: registration from starts on all sides of the model."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_core.object_models.nearest_grid import NearestGrid
from cdff_core.object_models.registration import register
from cdff_core.object_models.views import view_rotation

#: Iterations and points of the first registration, which starts from all poses, and of the second
#: registration.
_FIRST_ITERATIONS, _FIRST_POINTS = 8, 100
_SECOND_ITERATIONS, _SECOND_POINTS = 10, 400
#: Distance above which a point has no weight, in diameters: at the start and at the end of the first
#: registration, and its lower bound at the end of the second registration.
_FIRST_SCALE, _MIDDLE_SCALE, _LAST_SCALE = 0.25, 0.06, 0.015
#: Distance above which a point has no weight at the end of the second registration, in standard deviations
#: of the noise.
_SIGMAS = 3.0
#: Hypotheses whose rotations differ by less than this are the same.
_DISTINCT_RAD = math.radians(6.0)


class SurfaceModel(NamedTuple):
    """Surface for the registration: points and normals (n, 3), the grid of the points, and their extent."""

    points_m: FloatArray
    normals: FloatArray
    grid: NearestGrid
    diameter_m: float


def find_hypotheses(
    scan_m: FloatArray,
    surface: SurfaceModel,
    view_directions: FloatArray,
    view_centroids_m: FloatArray,
    *,
    rolls: int,
    count: int,
    sigma_m: float,
    seed: int,
) -> tuple[FloatArray, FloatArray]:
    """Return at most ``count`` distinct poses T_sensor_model (k, 4, 4) and their costs (k,), best first.

    Each start shows one of the views of the model to the sensor, with its visible centroid at the centroid of
    the scan.

    Parameters
    ----------
    scan_m : ndarray, shape (n, 3)
        Points of one body; the sensor is at the origin.
    surface : SurfaceModel
    view_directions, view_centroids_m : ndarray, shape (v, 3)
        Directions from the model to viewers, and the mean of the points that each sees.
    rolls : int
        Rotations about the line of sight for each view.
    sigma_m : float
        Standard deviation of the measured ranges.
    seed : int
        Seed of the choice of the points.
    """
    rng = np.random.default_rng(seed)
    diameter_m = surface.diameter_m
    starts = start_poses(np.median(scan_m, axis=0), view_directions, view_centroids_m, rolls)
    first = np.geomspace(_FIRST_SCALE, _MIDDLE_SCALE, _FIRST_ITERATIONS) * diameter_m
    poses, costs = _register(starts, _sample(scan_m, _FIRST_POINTS, rng), surface, first)
    rows = distinct(poses, np.argsort(costs, kind="stable"), count)
    last_m = max(_SIGMAS * sigma_m, _LAST_SCALE * diameter_m)
    second = np.geomspace(max(_MIDDLE_SCALE * diameter_m, last_m), last_m, _SECOND_ITERATIONS)
    poses, costs = _register(poses[rows], _sample(scan_m, _SECOND_POINTS, rng), surface, second)
    order = np.argsort(costs, kind="stable")
    return poses[order], costs[order]


def start_poses(
    centroid_m: FloatArray, view_directions: FloatArray, view_centroids_m: FloatArray, rolls: int
) -> FloatArray:
    """Return starts (v rolls, 4, 4) with the visible centroid of each view at a point (3,) of the sensor."""
    R_sensor_line = view_rotation(-centroid_m).T
    R_view = _view_rotations(view_directions.tobytes(), len(view_directions))
    R_roll = se3.exp_so3(np.arange(rolls)[:, None] * np.array([0.0, 0.0, 2.0 * math.pi / rolls]))
    R = R_sensor_line @ R_roll[None, :] @ R_view[:, None]
    poses = np.repeat(np.eye(4)[None], len(view_directions) * rolls, axis=0)
    poses[:, :3, :3] = R.reshape(-1, 3, 3)
    poses[:, :3, 3] = centroid_m - np.einsum("vrij,vj->vri", R, view_centroids_m).reshape(-1, 3)
    return poses


def distinct(poses: FloatArray, order: np.ndarray, count: int) -> list[int]:
    """Return at most ``count`` rows in the given order whose rotations differ by more than 6 degrees."""
    rows: list[int] = []
    selected_rotations = np.empty((count, 3, 3))
    least_trace = 1.0 + 2.0 * math.cos(_DISTINCT_RAD)
    for row in order:
        R = poses[row, :3, :3]
        traces = np.einsum("kij,ij->k", selected_rotations[: len(rows)], R)
        if not np.any(traces > least_trace):
            selected_rotations[len(rows)] = R
            rows.append(int(row))
            if len(rows) == count:
                break
    return rows


def _register(
    poses: FloatArray, scan_m: FloatArray, surface: SurfaceModel, scales_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Register hypotheses (n, 4, 4) with the surface of a model; return the poses and their costs (n,)."""
    return register(poses, scan_m, surface.points_m, surface.normals, surface.grid, scales_m)


def _sample(scan_m: FloatArray, count: int, rng: np.random.Generator) -> FloatArray:
    return scan_m if len(scan_m) <= count else scan_m[rng.permutation(len(scan_m))[:count]]


@lru_cache(maxsize=8)
def _view_rotations(data: bytes, count: int) -> FloatArray:
    """Return R_camera_model (v, 3, 3) of the views; the same views are asked for with each scan."""
    return np.stack([view_rotation(d) for d in np.frombuffer(data).reshape(count, 3)])

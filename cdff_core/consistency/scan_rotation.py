# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rotation of a lidar between two sweeps, from the shape of the ground around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.geometry.levelling import rotations_to_z
from cdff_common.geometry.se3 import FloatArray
from cdff_core.consistency.ground_plane import GroundPlane, ground_plane

#: Size of a cell and half of the side of the grid, metres; points that are used.
_CELL_M, _HALF_M, _POINTS = 0.5, 12.0, 2500
_SIDE = int(2 * _HALF_M / _CELL_M)
#: Least number of points of a cell, of cells of a local plane, and of points of a registration.
_LEAST_POINTS, _LEAST_CELLS, _LEAST_ROWS = 2, 5, 200
#: Number of steps of the registration, and largest standard deviation of the residuals, metres, after a
#: successful one.
_STEPS, _LARGEST_SIGMA_M = 4, 0.15
#: Distance of the neighbours of a cell in the flat grid.
_NEIGHBOURS = tuple(i * _SIDE + j for i in (-1, 0, 1) for j in (-1, 0, 1))


@dataclass(frozen=True, slots=True)
class LevelledSweep:
    """Sweep above its ground plane.

    Attributes
    ----------
    plane : GroundPlane
        Ground plane in base axes.
    R_level_base : ndarray, shape (3, 3)
        Rotation that maps the normal of the ground to z.
    points_m : ndarray, shape (n, 3)
        Points above the ground plane.
    """

    plane: GroundPlane
    R_level_base: FloatArray
    points_m: FloatArray


def levelled_sweep(points_m: NDArray[np.floating], expected: FloatArray) -> LevelledSweep | None:
    """Return a sweep above its ground plane; None without a ground.

    Parameters
    ----------
    points_m : ndarray, shape (n, 3)
        Points in base axes relative to the sensor, metres.
    expected : ndarray, shape (3,)
        Expected normal of the ground.
    """
    plane = ground_plane(points_m, expected)
    if plane is None:
        return None
    points = np.asarray(points_m[:: max(1, len(points_m) // (2 * _POINTS))], dtype=np.float64)
    points = points[np.einsum("ij,ij->i", points, points) < 2.0 * _HALF_M**2]  # false for NaN
    points = points[:: max(1, -(-len(points) // _POINTS))]
    R = rotations_to_z(plane.normal[None])[0]
    levelled = points @ R.T
    levelled[:, 2] += plane.distance_m
    return LevelledSweep(plane, R, levelled)


class ScanRotation:
    """Rotation between successive sweeps by point-to-plane registration on a grid of local planes.

    Roll and pitch of the sensor are determined by the ground to about 0.1 degrees; heading and horizontal
    translation only as far as the ground has relief.
    """

    def __init__(self) -> None:
        self._previous: LevelledSweep | None = None

    def reset(self) -> None:
        """Forget the previous sweep."""
        self._previous = None

    def add(self, sweep: LevelledSweep) -> FloatArray | None:
        """Return the rotation vector (3,) of the sensor since the previous sweep, in base axes.

        None for the first sweep and if the registration fails.
        """
        previous, self._previous = self._previous, sweep
        if previous is None:
            return None
        rotation = _register_rotation(_LocalPlanes(previous.points_m), sweep.points_m)
        if rotation is None:
            return None
        return se3.log_so3(previous.R_level_base.T @ rotation @ sweep.R_level_base)


class _LocalPlanes:
    """Plane through the means of each cell of a grid and its neighbours.

    Attributes
    ----------
    means_m : ndarray, shape (cells, 3)
    planes : ndarray, shape (cells, 3)
        Height above the mean position, and the slopes along x and y.
    valid : ndarray, shape (cells,)
    """

    def __init__(self, points_m: FloatArray) -> None:
        cells, inside = _cells(points_m)
        points, cells = points_m[inside], cells[inside]
        counts = np.bincount(cells, minlength=_SIDE * _SIDE)
        sums = [np.bincount(cells, points[:, k], minlength=_SIDE * _SIDE) for k in range(3)]
        self.means_m = np.column_stack(sums) / np.maximum(counts, 1)[:, None]
        self.planes = np.zeros((_SIDE * _SIDE, 3))
        self.valid = np.zeros(_SIDE * _SIDE, dtype=np.bool_)
        occupied = counts >= _LEAST_POINTS
        rows = np.flatnonzero(occupied)
        rows = rows[(rows >= _SIDE + 1) & (rows < _SIDE * (_SIDE - 1) - 1)]
        neighbour_rows = rows[:, None] + np.array(_NEIGHBOURS)
        weight = occupied[neighbour_rows].astype(np.float64)
        offsets = self.means_m[neighbour_rows] - self.means_m[rows][:, None]
        x = (
            np.concatenate([np.ones((*neighbour_rows.shape, 1)), offsets[..., :2]], axis=-1)
            * weight[..., None]
        )
        normal = np.einsum("nkj,nkl->njl", x, x)
        right = np.einsum("nkj,nk->nj", x, self.means_m[neighbour_rows][..., 2])
        usable = (weight.sum(axis=1) >= _LEAST_CELLS) & (np.linalg.det(normal) > 1e-3)
        rows = rows[usable]
        self.planes[rows] = np.linalg.solve(normal[usable], right[usable][..., None])[..., 0]
        self.valid[rows] = True


def _cells(points_m: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the cell of each point, and whether the point is in the grid."""
    ij = np.floor((points_m[:, :2] + _HALF_M) / _CELL_M).astype(np.int64)
    inside = ((ij >= 0) & (ij < _SIDE)).all(axis=1)
    return np.where(inside, ij[:, 0] * _SIDE + ij[:, 1], 0), np.asarray(inside)


def _register_rotation(planes: _LocalPlanes, points_m: FloatArray) -> FloatArray | None:
    """Return the rotation (3, 3) from the axes of points to those of planes; None if they do not fit."""
    T, sigma_m = np.eye(4), np.inf
    for _ in range(_STEPS):
        points_in_map = points_m @ T[:3, :3].T + T[:3, 3]
        cells, inside = _cells(points_in_map)
        usable = inside & planes.valid[cells]
        if np.count_nonzero(usable) < _LEAST_ROWS:
            return None
        q, cells = points_in_map[usable], cells[usable]
        plane, mean = planes.planes[cells], planes.means_m[cells]
        residual = q[:, 2] - plane[:, 0] - np.einsum("ij,ij->i", plane[:, 1:], q[:, :2] - mean[:, :2])
        normal = np.column_stack([-plane[:, 1], -plane[:, 2], np.ones(len(q))])
        J = np.concatenate([normal, np.cross(q, normal)], axis=1)
        sigma_m = 1.4826 * float(np.median(np.abs(residual))) + 1e-3
        weight = 1.0 / (1.0 + (residual / (2.0 * sigma_m)) ** 2) ** 2  # Geman-McClure
        H = (J * weight[:, None]).T @ J + 1e-6 * np.eye(6)
        step = np.linalg.solve(H, -(J * weight[:, None]).T @ residual)
        T = se3.transform(se3.exp_so3(step[3:]), step[:3]) @ T
    return T[:3, :3] if sigma_m <= _LARGEST_SIGMA_M else None

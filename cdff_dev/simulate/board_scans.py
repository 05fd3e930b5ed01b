# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lidar scans of a calibration board that stands in front of ground, walls and a box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_core.calibration.boards import Board


@dataclass(frozen=True)
class Surroundings:
    """Ground and walls in the frame of the lidar (z up), and a box of the size of a board.

    Attributes
    ----------
    ground_z_m, wall_x_m, wall_y_m : float
    box_m : tuple of float
        Position of the centre of the flat side of the box, which faces the lidar.
    """

    ground_z_m: float = -0.9
    wall_x_m: float = 9.0
    wall_y_m: float = 5.0
    box_m: tuple[float, float, float] = (3.5, 2.2, -0.3)


def ring_directions(rings: int, *, lowest_deg: float, highest_deg: float, step_deg: float) -> FloatArray:
    """Return unit vectors ``(n, 3)`` of a rotating lidar."""
    elevation = np.deg2rad(np.linspace(lowest_deg, highest_deg, rings))
    azimuth = np.deg2rad(np.arange(-180.0, 180.0, step_deg))
    e, a = np.meshgrid(elevation, azimuth, indexing="ij")
    return np.column_stack(
        [(np.cos(e) * np.cos(a)).ravel(), (np.cos(e) * np.sin(a)).ravel(), np.sin(e).ravel()]
    )


def panel_of(board: Board, margin_m: float) -> tuple[tuple[float, float], FloatArray]:
    """Return the sides of a panel with a margin around the pattern, and its centre (m)."""
    centre = np.mean([board.corners_m.min(axis=0), board.corners_m.max(axis=0)], axis=0)
    width, height = board.extent_m
    return (width + 2.0 * margin_m, height + 2.0 * margin_m), centre


def board_scan(
    T_lidar_board: FloatArray,
    size_m: tuple[float, float],
    centre_m: FloatArray,
    directions: FloatArray,
    rng: np.random.Generator,
    *,
    sigma_m: float = 0.01,
    surroundings: Surroundings | None = None,
) -> FloatArray:
    """Return the points ``(n, 3)`` of a scan in the frame of the lidar, with noise of the ranges.

    Parameters
    ----------
    T_lidar_board : ndarray, shape (4, 4)
    size_m : (float, float)
        Sides of the panel along x and y of the board.
    centre_m : ndarray, shape (3,)
        Centre of the panel in the frame of the board.
    directions : ndarray, shape (n, 3)
    """
    place = surroundings or Surroundings()
    ranges = np.full(len(directions), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis, value in (
            (2, place.ground_z_m),
            (0, place.wall_x_m),
            (1, place.wall_y_m),
            (1, -place.wall_y_m),
        ):
            t = value / directions[:, axis]
            ranges = np.where((t > 0.0) & (t < ranges), t, ranges)
        panel = T_lidar_board @ se3.transform(np.eye(3), centre_m)
        box = se3.transform(se3.matrix_from_quaternion_xyzw([-0.5, 0.5, -0.5, 0.5]), place.box_m)
        for T in (panel, box):
            local, origin = directions @ T[:3, :3], -T[:3, 3] @ T[:3, :3]
            t = -origin[2] / local[:, 2]
            hits = origin[:2] + t[:, None] * local[:, :2]
            inside = (np.abs(hits) < 0.5 * np.array(size_m)).all(axis=1) & (t > 0.0)
            ranges = np.where(inside & (t < ranges), t, ranges)
    ranges = ranges + rng.normal(0.0, sigma_m, len(ranges))
    is_hit = np.isfinite(ranges) & (ranges < 60.0)
    return np.asarray(directions[is_hit] * ranges[is_hit, None])

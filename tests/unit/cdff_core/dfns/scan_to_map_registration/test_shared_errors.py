# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Gradients by errors that points share: compared with finite differences on a plane."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.dfns.scan_to_map_registration._shared_errors import shared_gradients
from cdff_core.dfns.scan_to_map_registration._voxel_map import VoxelMap


@pytest.fixture(scope="module")
def plane() -> VoxelMap:
    """A map of the plane z = 0."""
    x, y = (v.ravel() for v in np.meshgrid(np.arange(-8.0, 8.0, 0.1), np.arange(-8.0, 8.0, 0.1)))
    ground = VoxelMap(1.0, 2, 30.0)
    ground.add(np.column_stack([x, y, np.zeros(len(x))]), np.zeros(3))
    return ground


def gradients(ground: VoxelMap, points: np.ndarray, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the gradients of a scan without motion at the pose T_map_sensor."""
    zero = np.zeros(3)
    return shared_gradients(
        ground.tables, ground.voxel_m, points, np.zeros(len(points)), T[:3, :3].copy(), T[:3, 3].copy(), zero,
        zero, 1.0, np.full(2, 0.02),
    )  # fmt: skip


def scan_of_plane(T: np.ndarray) -> np.ndarray:
    """Return the points of 8 rings on the plane z = 0, in the frame of the sensor."""
    elevation, azimuth = (
        v.ravel() for v in np.meshgrid(np.radians(np.arange(-49.9, -18.0, 4.0)), np.arange(0, 6.2, 0.2))
    )
    rays = np.column_stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    return rays * (-T[2, 3] / (rays @ T[2, :3]))[:, None]


def moved(points: np.ndarray, range_m: float, elevation_rad: float) -> np.ndarray:
    """Return the points with errors of range and elevation."""
    horizontal = np.linalg.norm(points[:, :2], axis=1)
    range_of = np.linalg.norm(points, axis=1) + range_m
    elevation = np.arctan2(points[:, 2], horizontal) + elevation_rad
    direction = points[:, :2] / horizontal[:, None] * np.cos(elevation)[:, None]
    return np.column_stack([direction, np.sin(elevation)]) * range_of[:, None]


def test_the_gradients_are_the_derivatives_by_range_and_elevation_of_the_rings(plane: VoxelMap) -> None:
    T = se3.transform(se3.exp_so3([0.05, -0.03, 0.4]), [0.2, 0.1, 1.5])
    points, step = scan_of_plane(T), 1e-6
    rings, _ = gradients(plane, points, T)
    for i, (range_m, elevation_rad) in enumerate(((step, 0.0), (0.0, step))):
        above = gradients(plane, moved(points, range_m, elevation_rad), T)[1].sum(axis=0)
        below = gradients(plane, moved(points, -range_m, -elevation_rad), T)[1].sum(axis=0)
        expected = (above - below) / (2.0 * step)
        assert np.abs(expected).max() > 1.0
        # At the borders of voxels a point can change its plane.
        largest = np.abs(expected).max()
        np.testing.assert_allclose(rings[:, i].sum(axis=0), expected, rtol=0.02, atol=0.01 * largest)


def test_points_of_a_ring_are_in_the_bin_of_their_elevation(plane: VoxelMap) -> None:
    T = se3.transform(np.eye(3), [0.0, 0.0, 1.5])
    rings, planes = gradients(plane, scan_of_plane(T), T)
    bins = np.flatnonzero(np.abs(rings).sum(axis=(1, 2)))
    # 720 bins of a quarter of a degree from -90 degrees.
    np.testing.assert_allclose(0.25 * bins - 90.0, np.arange(-49.9, -18.0, 4.0), atol=0.26)
    assert len(planes) > 10

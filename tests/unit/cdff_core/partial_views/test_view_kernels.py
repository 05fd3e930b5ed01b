# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of the partial views on a few points: classes of visible points, hidden points, signs."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.partial_views.model_surface import consistent_signs, sphere_directions, unhidden_points
from cdff_core.partial_views.view_comparison import _counts

Array = np.ndarray
AGREES, IN_FRONT, BEHIND, UNKNOWN = range(4)
LOW, PIXEL = np.array([-0.5, -0.4]), 0.1


def classes(
    depth: Array, T: Array, points: Array, directions: Array, visible: Array, tolerance: float
) -> Array:
    """Return the numbers of the visible points by class."""
    view = int(np.argmax(directions @ (-T[:3, :3].T @ T[:3, 3])))
    out = np.zeros(4, int)
    for x, y, z in se3.transform_points(T, points[visible[view]]):
        column, row = (int(np.floor((c / z - low) / PIXEL)) for c, low in ((x, LOW[0]), (y, LOW[1])))
        inside = z > 0.0 and 0 <= row < depth.shape[0] and 0 <= column < depth.shape[1]
        if not inside or np.isinf(depth[row, column]):
            out[UNKNOWN] += 1
        else:
            difference = depth[row, column] - z
            out[IN_FRONT if difference > tolerance else BEHIND if difference < -tolerance else AGREES] += 1
    return out


def test_visible_points_are_classified_by_the_depth_of_their_pixel() -> None:
    rng = np.random.default_rng(1)
    depth = rng.uniform(2.5, 3.5, (8, 10))
    depth[rng.random(depth.shape) < 0.2] = np.inf
    points, directions = rng.normal(0.0, 0.6, (50, 3)), sphere_directions(7)
    visible = rng.random((7, 50)) < 0.6
    poses = np.array(
        [
            se3.transform(se3.exp_so3(rng.normal(size=3)), [*rng.normal(0.0, 0.2, 2), z])
            for z in (3.0, 2.8, 3.2, 0.3, -3.0)
        ]
    )
    out = _counts(depth, LOW, PIXEL, poses, points, directions, visible, 0.2)
    expected = [classes(depth, T, points, directions, visible, 0.2) for T in poses]
    np.testing.assert_array_equal(out, expected)
    assert np.all(out.sum(axis=0) > 0)


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((0.0, 0.0, 2.0), AGREES),
        ((0.0, 0.0, 1.75), AGREES),
        ((0.0, 0.0, 1.7499), IN_FRONT),
        ((0.0, 0.0, 2.25), AGREES),
        ((0.0, 0.0, 2.2501), BEHIND),
        ((0.0, 0.0, 0.0), UNKNOWN),
        ((0.0, 0.0, -2.0), UNKNOWN),
        ((-1.0, -0.8, 2.0), AGREES),
        ((-1.001, -0.8, 2.0), UNKNOWN),
        ((-1.0, -0.801, 2.0), UNKNOWN),
        ((0.999, 0.799, 2.0), AGREES),
        ((1.001, 0.799, 2.0), UNKNOWN),
        ((0.999, 0.801, 2.0), UNKNOWN),
    ],
)
def test_the_borders_of_image_and_tolerance(point: tuple[float, float, float], expected: int) -> None:
    depth = np.full((8, 10), 2.0)
    low = np.array([-0.5, -0.4])
    out = _counts(
        depth,
        low,
        0.1,
        np.eye(4)[None],
        np.array([point]),
        np.array([[0.0, 0.0, -1.0]]),
        np.ones((1, 1), bool),
        0.25,
    )
    np.testing.assert_array_equal(out[0], np.eye(4, dtype=int)[expected])


def test_directions_are_those_of_the_fibonacci_spiral() -> None:
    directions = sphere_directions(20)
    k = np.arange(20)
    np.testing.assert_allclose(directions[:, 2], 1.0 - (2 * k + 1) / 20, atol=1e-15)
    golden = np.pi * (3.0 - np.sqrt(5.0))
    turn = np.unwrap(np.arctan2(directions[:, 1], directions[:, 0]))
    np.testing.assert_allclose((turn - golden * k + np.pi) % (2 * np.pi), np.pi, atol=1e-9)


def nearest_heights(points: Array, direction: Array, pixel: float) -> Array:
    """Return which points are within 1.5 pixels of the highest one of their pixel."""
    radius = float(np.abs(points).max())
    pixel = max(pixel, 2.0 * np.sqrt(3.0) * radius / 2000)
    size = int(2.0 * np.sqrt(3.0) * radius / pixel) + 3
    u = np.cross(direction, [1.0, 0.0, 0.0] if abs(direction[0]) < 0.7 else [0.0, 1.0, 0.0])
    u /= np.linalg.norm(u)
    cells = np.floor(points @ np.array([u, np.cross(direction, u)]).T / pixel + 0.5 * size)
    height = points @ direction
    same = np.all(cells[:, None] == cells[None], axis=2)
    return height >= np.where(same, height, -np.inf).max(axis=1) - 1.5 * pixel


@pytest.mark.parametrize("pixel", [0.05, 0.3, 1.0, 1e-6])
def test_a_point_is_hidden_by_one_of_its_pixel_that_is_much_higher(pixel: float) -> None:
    rng = np.random.default_rng(2)
    points = rng.uniform(-1.0, 1.0, (60, 3))
    points[30:] = points[:30] * 0.5
    directions = np.vstack([sphere_directions(6), np.eye(3), [[0.7, 0.714, 0.02], [-0.9, 0.3, 0.3]]])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    expected = [nearest_heights(points, d, pixel) for d in directions]
    np.testing.assert_array_equal(unhidden_points(points, directions, pixel), expected)


def test_neighbours_get_signs_along_the_path_of_the_most_parallel_normals() -> None:
    """A strip of normals that turns by 20 degrees from point to point, with random signs."""
    rng = np.random.default_rng(3)
    angles = np.radians(20.0 * np.arange(14))
    along = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(14)])
    flips = rng.choice([-1.0, 1.0], 14)
    index = np.clip(np.arange(14)[:, None] + [[-1, 0, 1]], 0, 13)
    index[0, 0] = index[13, 2] = -1
    signs = consistent_signs(along * flips[:, None], index)
    assert signs[0] == 1.0
    np.testing.assert_array_equal(signs * flips, np.full(14, flips[0]))


def test_the_sign_comes_from_the_more_parallel_neighbour_and_orthogonal_ones_agree() -> None:
    normals = np.array([[1.0, 0.0, 0.0], [-0.6, 0.8, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
    index = np.array([[1, 2, 14], [0, 2, -1], [0, 1, 3], [2, 2, 2]])
    # 0-1: 0.6 reversed; 1-2: 0.8 reversed, 0-2 orthogonal; 2-3 orthogonal, the sign of 2.
    assert consistent_signs(normals, index).tolist() == [1.0, -1.0, 1.0, 1.0]
    apart = np.array([[-1], [-1]])
    assert consistent_signs(np.array([[1.0, 0, 0], [-1.0, 0, 0]]), apart).tolist() == [1.0, 1.0]

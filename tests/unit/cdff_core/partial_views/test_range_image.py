# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Range image of a scene against its pixels one by one; scenes that are no single view are refused."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.partial_views.range_image import range_image


def wall(rng: np.random.Generator, n: int = 4000, depth_m: float = 2.0) -> np.ndarray:
    """Return points of a rough wall across the z axis."""
    xy = rng.uniform(-1.0, 1.0, (n, 2)) * [1.0, 0.4]
    return np.column_stack([xy, depth_m + 0.02 * rng.normal(size=n)])


@pytest.mark.parametrize("rotation", [[0.0, 0.0, 0.0], [0.0, 1.2, 0.3], [-1.4, 0.2, 0.1]])
def test_each_pixel_has_the_depth_of_its_nearest_point_or_the_median_around_it(
    rng: np.random.Generator, rotation: list[float]
) -> None:
    points = wall(rng) @ se3.exp_so3(rotation).T
    image = range_image(points)
    assert image is not None
    axis = np.mean(points / np.linalg.norm(points, axis=1, keepdims=True), axis=0)
    np.testing.assert_allclose(image.R_view_scene[2], axis / np.linalg.norm(axis), atol=1e-12)
    np.testing.assert_allclose(image.R_view_scene @ image.R_view_scene.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(image.R_view_scene) == pytest.approx(1.0)
    view = points @ image.R_view_scene.T
    uv = view[:, :2] / view[:, 2:]
    np.testing.assert_allclose(image.low, uv.min(axis=0))
    assert image.pixel == pytest.approx(1.5 * image.spacing)
    expected: dict[tuple[int, int], float] = {}
    for (u, v), z in zip(uv, view[:, 2], strict=True):
        key = int((v - image.low[1]) // image.pixel), int((u - image.low[0]) // image.pixel)
        expected[key] = min(expected.get(key, np.inf), z)
    rows, columns = zip(*expected, strict=True)
    assert image.depth_m.shape == (max(rows) + 1, max(columns) + 1)
    padded = np.full(np.add(image.depth_m.shape, 2), np.nan)
    for (row, column), z in expected.items():
        padded[row + 1, column + 1] = z
    filled = 0
    for row, column in np.ndindex(image.depth_m.shape):
        measured = padded[row + 1, column + 1]
        around = np.delete(padded[row : row + 3, column : column + 3].ravel(), 4)
        if np.isnan(measured):  # the median of four neighbours or more, otherwise empty
            is_filled = np.isfinite(around).sum() >= 4
            measured = np.nanmedian(around) if is_filled else np.inf
            filled += is_filled
        assert image.depth_m[row, column] == pytest.approx(measured)
    assert 10 < filled < np.isinf(image.depth_m).sum() + filled


def test_pixels_are_at_most_two_thousand_on_a_side(rng: np.random.Generator) -> None:
    points = wall(rng, 300)
    image = range_image(np.repeat(points, 3, axis=0))  # the distance between repeated points is 0
    assert image is not None
    view = points @ image.R_view_scene.T
    extent = np.ptp(view[:, :2] / view[:, 2:], axis=0)
    assert image.pixel == pytest.approx(extent.max() / 2000)
    assert max(image.depth_m.shape) == pytest.approx(2000, abs=1)


def test_points_at_the_sensor_are_ignored(rng: np.random.Generator) -> None:
    points = wall(rng)
    first, second = range_image(points), range_image(np.vstack([np.zeros((50, 3)), points]))
    assert first is not None
    assert second is not None
    np.testing.assert_array_equal(first.depth_m, second.depth_m)


def test_scenes_around_the_sensor_or_of_two_surfaces_are_no_single_view(rng: np.random.Generator) -> None:
    around = rng.normal(size=(3000, 3))
    assert range_image(around) is None
    front = wall(rng, 6000)
    few, many = (np.vstack([front, wall(rng, n, 3.0)]) for n in (150, 3000))
    assert range_image(few) is not None
    assert range_image(many) is None


def test_at_most_one_percent_of_the_points_is_far_from_the_axis(rng: np.random.Generator) -> None:
    front = wall(rng, 1000)
    aside = np.tile([[0.0, 8.0, 1.0]], (9, 1)) + 0.01 * rng.normal(size=(9, 3))
    assert range_image(np.vstack([front, aside])) is not None
    assert range_image(np.vstack([front, np.repeat(aside, 2, axis=0)])) is None

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The compiled search along rows agrees with the correlation of each patch, and has exact limits."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.imaging.patch_alignment import search_rows

Array = np.ndarray
HALF = 2


def patch(image: Array, x: int, y: int) -> Array:
    return image[y - HALF : y + HALF + 1, x - HALF : x + HALF + 1].astype(np.float64).ravel()


def searched(
    left: Array, right: Array, point: Array, lowest: int, highest: int
) -> tuple[float, float, float]:
    """Return the best disparity, its correlation, and the best one more than two pixels away."""
    x, y = round(point[0]), round(point[1])
    tested = [d for d in range(lowest, highest + 1) if HALF <= x - d < right.shape[1] - HALF]
    scores = [float(np.corrcoef(patch(left, x, y), patch(right, x - d, y))[0, 1]) for d in tested]
    top = int(np.argmax(scores))
    others = [s for d, s in zip(tested, scores, strict=True) if abs(d - tested[top]) > 2]
    return tested[top], scores[top], max(others, default=-1.0)


@pytest.mark.parametrize(("lowest", "highest"), [(0, 9), (3, 3), (0, 2), (-6, 30), (2, 5)])
def test_the_best_disparity_is_that_of_an_exhaustive_search(lowest: int, highest: int) -> None:
    rng = np.random.default_rng(1)
    left, right = (np.asarray(rng.normal(100.0, 20.0, (12, 24)), np.float32) for _ in range(2))
    points = np.array([[12.4, 5.6], [13.0, 2.0], [9.51, 9.0], [16.0, 7.49], [11.0, 6.0]])
    n = len(points)
    disparity, best, second = search_rows(
        left, right, points, np.full(n, lowest, np.int64), np.full(n, highest, np.int64), HALF
    )
    for i, point in enumerate(points):
        expected = searched(left, right, point, lowest, highest)
        assert disparity[i] == expected[0]
        np.testing.assert_allclose([best[i], second[i]], expected[1:], atol=1e-4)


def of_single(
    left: Array, right: Array, point: tuple[float, float], lowest: int, highest: int
) -> list[float]:
    results = search_rows(left, right, np.array([point]), np.array([lowest]), np.array([highest]), HALF)
    return [float(values[0]) for values in results]


def noise(seed: int, rows: int = 12, cols: int = 24) -> Array:
    return np.asarray(np.random.default_rng(seed).normal(100.0, 20.0, (rows, cols)), np.float32)


@pytest.mark.parametrize(
    ("point", "is_inside"),
    [((2, 6), True), ((1, 6), False), ((21, 6), True), ((22, 6), False), ((9, 2), True), ((9, 1), False),
     ((9, 9), True), ((9, 10), False), ((1.6, 6), True), ((1.4, 6), False)],
)  # fmt: skip
def test_patches_lie_within_the_left_image(point: tuple[float, float], is_inside: bool) -> None:
    left = noise(2)
    result = of_single(left, left, point, 0, 0)
    if is_inside:
        np.testing.assert_allclose(result, [0.0, 1.0, -1.0], atol=1e-5)
    else:
        np.testing.assert_array_equal(result, [np.nan, -1.0, -1.0])


def test_disparities_are_limited_to_the_right_image() -> None:
    left = noise(3)
    right = np.ascontiguousarray(left[:, 4:20])  # columns 4 to 19, so that the disparity is 4
    np.testing.assert_allclose(of_single(left, right, (6, 6), 4, 4)[:2], [4.0, 1.0], atol=1e-5)
    np.testing.assert_array_equal(of_single(left, right, (6, 6), 5, 9), [np.nan, -1.0, -1.0])
    np.testing.assert_allclose(of_single(left, right, (17, 6), 4, 4)[:2], [4.0, 1.0], atol=1e-5)
    np.testing.assert_array_equal(of_single(left, right, (17, 6), -9, 3), [np.nan, -1.0, -1.0])
    np.testing.assert_array_equal(of_single(left, right, (12, 6), 5, 4), [np.nan, -1.0, -1.0])


def test_flat_patches_have_no_correlation() -> None:
    left = noise(4)
    flat = np.zeros_like(left)  # without rounding of the sums in single precision
    np.testing.assert_array_equal(of_single(flat, left, (12, 6), 0, 5), [np.nan, -1.0, -1.0])
    np.testing.assert_array_equal(of_single(left, flat, (12, 6), 2, 5), [2.0, -1.0, -1.0])


@pytest.mark.parametrize(("factor", "has_structure"), [(0.98, False), (1.02, True)])
def test_the_limit_of_structure_is_a_thousandth_squared_grey_level(
    factor: float, has_structure: bool
) -> None:
    image = noise(5) - np.float32(100.0)
    values = patch(image, 12, 6)
    weak = image * np.float32(np.sqrt(factor * 1e-3 / np.sum((values - values.mean()) ** 2)))
    result = of_single(weak, image, (12, 6), 0, 0)
    np.testing.assert_allclose(result[:2], [0.0, 1.0] if has_structure else [np.nan, -1.0], atol=1e-4)
    # The patch of the right image, around zero so that rounding is small.
    result = of_single(image, weak, (12, 6), 0, 0)
    np.testing.assert_allclose(result[:2], [0.0, 1.0 if has_structure else -1.0], atol=1e-4)


def test_the_lower_of_two_equal_disparities_is_returned_and_the_second_is_three_pixels_away() -> None:
    period = noise(6, 12, 3)
    left = np.ascontiguousarray(np.tile(period, (1, 8)))
    disparity, best, second = of_single(left, left, (16, 6), 1, 8)
    assert disparity == 3.0
    assert best == second == pytest.approx(1.0, abs=1e-5)
    disparity, best, second = of_single(left, left, (16, 6), 1, 5)
    assert disparity == 3.0
    assert second == -1.0

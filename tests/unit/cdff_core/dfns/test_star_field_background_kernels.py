# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of TileMedian against numpy: statistics, interpolation, and the limits of a trail."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from cdff_core.dfns.star_field_background._kernels import mark_trails, subtract_background
from cdff_core.dfns.star_field_background.tile_median import tile_statistics


def expected_statistics(values: np.ndarray) -> tuple[float, float]:
    """Return the median, and the deviation of the values within three of its own, corrected for the cut."""
    centre = float(np.median(values))
    sigma = max(centre - np.sort(values.ravel())[int(0.1587 * values.size)], 1e-6)
    for _ in range(2):
        deviations = values.ravel() - centre
        near = deviations[np.abs(deviations) <= 3.0 * sigma]
        if near.size > 2:
            sigma = max(float(np.std(near)) / 0.98658, 1e-6)
    return centre, sigma


@pytest.mark.parametrize(("height", "width", "step"), [(8, 6, 1), (9, 7, 2), (9, 7, 3)])
def test_statistics_of_each_tile_are_those_of_its_own_pixels(height: int, width: int, step: int) -> None:
    rng = np.random.default_rng(3)
    image = rng.normal(50.0, 4.0, (3 * height + 2, 2 * width + 1)).astype(np.float32)
    image[rng.random(image.shape) < 0.1] += 300.0
    image += 100.0 * np.arange(image.shape[1], dtype=np.float32)
    medians, sigmas = tile_statistics(image, (3, 2), (height, width), step)
    for i in range(3):
        for j in range(2):
            tile = image[i * height : (i + 1) * height : step, j * width : (j + 1) * width : step]
            expected = expected_statistics(tile.astype(np.float64))
            np.testing.assert_allclose((medians[i, j], sigmas[i, j]), expected, rtol=1e-6)


def test_a_constant_tile_has_the_least_deviation() -> None:
    medians, sigmas = tile_statistics(np.full((4, 4), 7.0, np.float32), (1, 1), (4, 4), 1)
    assert (medians.tolist(), sigmas.tolist()) == ([[7.0]], [[1e-6]])


@pytest.mark.parametrize(("height", "width", "shape"), [(8, 6, (30, 23)), (9, 7, (27, 21)), (16, 5, (17, 6))])
def test_background_and_noise_are_linear_between_the_centres_of_tiles(
    height: int, width: int, shape: tuple[int, int]
) -> None:
    rng = np.random.default_rng(4)
    tiles = rng.uniform(10.0, 90.0, (2, shape[0] // height + 3, shape[1] // width + 3))
    image = rng.uniform(0.0, 200.0, shape).astype(np.float32)
    residual, noise = np.empty_like(image), np.empty_like(image)
    subtract_background(image, tiles[0], tiles[1], height, width, residual, noise)
    # The first tile lies before the image.
    places = [(np.arange(n) + 0.5) / side + 0.5 for n, side in zip(shape, (height, width), strict=True)]
    levels, sigmas = (
        RegularGridInterpolator([np.arange(n) for n in t.shape], t)(
            tuple(np.meshgrid(*places, indexing="ij"))
        )
        for t in tiles
    )
    np.testing.assert_allclose(residual, image - levels, atol=1e-4)
    np.testing.assert_allclose(noise, sigmas, atol=1e-4)


def trails(residual: np.ndarray, length: float = 20.0, threshold: float = 3.0) -> tuple[int, np.ndarray]:
    mask = np.zeros(residual.shape, np.uint8)
    noise = np.full(residual.shape, 2.0, np.float32)
    labels = np.zeros(residual.shape, np.int32)
    return mark_trails(residual.astype(np.float32), noise, mask, labels, threshold, length, 9), mask


def test_a_trail_is_masked_with_three_pixels_around_it_and_no_other_pixel() -> None:
    residual = np.zeros((40, 60))
    residual[20, 10:41] = 100.0
    count, mask = trails(residual)
    assert count == 1
    expected = np.zeros(residual.shape, np.uint8)
    expected[17:24, 7:44] = 9
    np.testing.assert_array_equal(mask, expected)


def test_trails_at_the_border_in_both_directions_are_counted() -> None:
    residual = np.zeros((40, 60))
    residual[0, 10:41] = 100.0
    residual[5:36, 59] = 100.0
    residual[5:36, 58] = 100.0
    count, mask = trails(residual)
    assert count == 2
    assert mask[0:4, 10:41].all()
    assert mask[5:36, 55:].all()
    assert not mask[20:, :50].any()


@pytest.mark.parametrize(
    ("pixels", "is_trail"),
    [
        (np.s_[20, 10:31], True),  # 20 pixels from first to last
        (np.s_[20, 10:30], False),
        (np.s_[20:23, 10:34], True),  # 24 x 3 pixels: more than eight times as long as wide
        (np.s_[20:23, 10:32], False),
    ],
)
def test_the_limits_of_a_trail_are_its_length_and_its_ratio_of_length_to_width(
    pixels: tuple[slice, slice], is_trail: bool
) -> None:
    residual = np.zeros((40, 60))
    residual[pixels] = 100.0
    count, mask = trails(residual)
    assert (count == 1, bool(mask.any())) == (is_trail, is_trail)


def test_pixels_at_the_threshold_are_not_part_of_a_trail() -> None:
    residual = np.zeros((40, 60))
    residual[20, 10:41] = 6.0
    assert trails(residual)[0] == 0
    residual[20, 10:41] = 6.01
    assert trails(residual)[0] == 1

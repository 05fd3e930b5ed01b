# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_core.imaging.patch_alignment import align_patches, align_slanted, search_rows
from cdff_core.imaging.pyramid import pyramid, smoothed
from tests.support.corridor import texture


def shifted(image: NDArray[np.float32], dx: float, dy: float) -> NDArray[np.uint8]:
    """Return the periodic image shifted by a fraction of a pixel, without interpolation error."""
    fy, fx = np.fft.fftfreq(image.shape[0])[:, None], np.fft.rfftfreq(image.shape[1])[None, :]
    shifted_image = np.fft.irfft2(
        np.fft.rfft2(image) * np.exp(-2j * np.pi * (fx * dx + fy * dy)), s=image.shape
    )
    return np.asarray(np.clip(np.rint(shifted_image), 0, 255), dtype=np.uint8)


def magnifications(n: int, scale: float = 1.0) -> NDArray[np.float64]:
    return np.tile(np.diag([scale, scale, 1.0]), (n, 1, 1))


POINTS = np.stack(np.meshgrid(np.arange(40.0, 216.0, 16.0), np.arange(40.0, 216.0, 16.0)), axis=-1).reshape(
    -1, 2
)


@pytest.mark.parametrize("fraction", [0.0, 0.25, 0.5, 0.8])
def test_a_translation_is_estimated_to_a_few_hundredths_of_a_pixel(fraction: float) -> None:
    image = cv2.GaussianBlur(texture(1, 256), (0, 0), 1.0)
    first, second = smoothed(shifted(image, 0.0, 0.0)), smoothed(shifted(image, 2.0 + fraction, -1.0))
    start = POINTS + np.array([2.0, -1.0])
    result, score = align_patches(first, second, POINTS, start, magnifications(len(POINTS)), 7, 20, 0.005)
    error = result - POINTS - [2.0 + fraction, -1.0]
    assert np.all(score > 0.95)
    assert np.all(np.abs(np.median(error, axis=0)) < 0.02)
    assert np.percentile(np.abs(error), 95) < 0.06


def test_gain_and_offset_of_the_grey_values_do_not_affect_the_result() -> None:
    image = smoothed(shifted(texture(2, 256), 0.0, 0.0))
    result, score = align_patches(
        image, 0.4 * image + 30.0, POINTS, POINTS + 0.7, magnifications(len(POINTS)), 7, 20, 0.005
    )
    assert np.all(score > 0.99)
    np.testing.assert_allclose(result, POINTS, atol=0.02)


def test_a_patch_of_known_magnification_is_located() -> None:
    image = cv2.GaussianBlur(texture(3, 256), (0, 0), 1.5).astype(np.float32)
    M = np.array([[1.3, 0.0, -0.3 * 128.0], [0.0, 1.3, -0.3 * 128.0]])
    larger = cv2.warpAffine(image, M, (256, 256), flags=cv2.INTER_CUBIC)
    central_points = POINTS[np.all(np.abs(POINTS - 128.0) < 70.0, axis=1)]
    truth = central_points @ M[:, :2].T + M[:, 2]
    result, score = align_patches(
        image, larger, central_points, truth + 1.0, magnifications(len(central_points), 1.3), 7, 20, 0.005
    )
    assert np.all(score > 0.97)
    assert np.percentile(np.abs(result - truth), 95) < 0.05


def test_a_patch_on_a_slope_is_located_and_its_slope_estimated() -> None:
    """The disparity increases by 0.3 px per row and decreases by 0.1 px per column, as on the ground."""
    image = cv2.GaussianBlur(texture(4, 256), (0, 0), 1.5).astype(np.float32)
    slope = np.array([-0.1, 0.3])
    M = np.array([[1.0 - slope[0], -slope[1], -20.0 + slope @ [128.0, 128.0]], [0.0, 1.0, 0.0]])
    right = cv2.warpAffine(image, M, (256, 256), flags=cv2.INTER_CUBIC)
    central_points = POINTS[np.all(np.abs(POINTS - 128.0) < 70.0, axis=1)]
    truth = central_points @ M[:, :2].T + M[:, 2]
    result, slopes, score = align_slanted(image, right, central_points, np.rint(truth), 7, 20, 0.005, 0.8)
    assert np.mean(score > 0.97) > 0.95
    error_px, slope_error = (result - truth)[score > 0.97], (slopes - slope)[score > 0.97]
    assert np.percentile(np.abs(error_px), 95) < 0.03
    assert np.percentile(np.abs(slope_error), 95) < 0.02
    without_slope, _ = align_patches(
        image, right, central_points, np.rint(truth), magnifications(len(central_points)), 7, 20, 0.005
    )
    assert np.sqrt(np.mean((without_slope - truth) ** 2)) > 10.0 * np.sqrt(np.mean(error_px**2))


def test_flat_and_outside_points_are_not_located() -> None:
    flat = np.full((64, 64), 100.0, np.float32)
    points = np.array([[32.0, 32.0], [2.0, 2.0], [200.0, 32.0]])
    _, score = align_patches(flat, flat, points, points, magnifications(3), 5, 10, 0.01)
    assert list(score) == [-1.0, -1.0, -1.0]
    _, slopes, score = align_slanted(flat, flat, points, points, 5, 10, 0.01, 0.8)
    assert list(score) == [-1.0, -1.0, -1.0]
    assert not slopes.any()


def test_a_search_along_rows_finds_integer_disparities() -> None:
    image = texture(4, 256)
    left, right = smoothed(shifted(image, 0.0, 0.0)), smoothed(shifted(image, -17.0, 0.0))
    n = len(POINTS)
    disparity, best, second = search_rows(
        left, right, POINTS, np.zeros(n, np.int64), np.full(n, 40, np.int64), 5
    )
    reachable = POINTS[:, 0] >= 17 + 5
    assert np.all(disparity[reachable] == 17.0)
    assert np.all(best[reachable] > second[reachable])


def test_a_pyramid_halves_each_level_and_refuses_invalid_images() -> None:
    assert [level.shape for level in pyramid(np.zeros((120, 200), np.uint8), 3)] == [(120, 200), (60, 100)]
    with pytest.raises(InputError, match="uint8"):
        smoothed(np.zeros((64, 64), np.float32))  # type: ignore[arg-type]


@pytest.mark.parametrize(("rows", "sizes"), [(64, [64, 32]), (63, [63]), (256, [256, 128, 64])])
def test_a_pyramid_has_no_level_below_32_pixels(rows: int, sizes: list[int]) -> None:
    assert [level.shape[0] for level in pyramid(np.zeros((rows, 256), np.uint8), 3)] == sizes

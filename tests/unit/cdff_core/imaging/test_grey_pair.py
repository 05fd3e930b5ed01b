# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stereo pairs of 8 and 16 bit as 8-bit grey images."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.types import Frame
from cdff_core.imaging.grey_pair import grey_pair


def frame(pixels: np.ndarray) -> Frame:
    return Frame.from_image(pixels, stamp_ns=0)


def test_the_brightest_pixels_of_the_left_image_scale_both_images_of_16_bit() -> None:
    left = np.array([[0, 1000, 2000, 2000]], np.uint16)
    grey_left, grey_right = grey_pair(frame(left), frame(2 * left))
    assert grey_left.dtype == grey_right.dtype == np.uint8
    np.testing.assert_allclose(grey_left, [[0, 127.5, 255, 255]], atol=1.0)
    np.testing.assert_array_equal(grey_right, [[0, 255, 255, 255]])
    grey_left, grey_right = grey_pair(frame(2 * left), frame(left))
    np.testing.assert_allclose(grey_left, [[0, 127.5, 255, 255]], atol=1.0)
    np.testing.assert_allclose(grey_right, [[0, 64, 127.5, 127.5]], atol=1.0)


def test_images_of_8_bit_and_black_images_are_unchanged() -> None:
    left = np.array([[0, 7, 200]], np.uint8)
    for grey, pixels in zip(grey_pair(frame(left), frame(left // 2)), (left, left // 2), strict=True):
        np.testing.assert_array_equal(grey, pixels)
    black = frame(np.zeros((1, 3), np.uint16))
    for grey in grey_pair(black, black):
        np.testing.assert_array_equal(grey, [[0, 0, 0]])


@pytest.mark.parametrize(
    "right",
    [np.zeros((2, 3), np.uint16), np.zeros((2, 4), np.uint8)],
    ids=["depth", "size"],
)
def test_a_pair_of_different_depth_or_size_is_refused(right: np.ndarray) -> None:
    with pytest.raises(InputError, match="expected the same size and depth"):
        grey_pair(frame(np.zeros((2, 3), np.uint8)), frame(right))

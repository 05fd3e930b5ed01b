# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images of two cameras are matched by their names and stamps."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.imaging.pair_rectifier import PAIR_TOLERANCE_NS
from cdff_dev.logs.stereo_pairs import counterpart, matched_stamps


@pytest.mark.parametrize(
    ("left", "right", "common"),
    [
        ("/front/left/image", "/front/right/image", "/front//image"),
        ("Left_raw", "Right_raw", "_raw"),
        ("navcam_left_rect", "navcam_right_rect", "navcam__rect"),
        ("/cam0/image_raw", "/cam1/image_raw", "//image_raw"),
        ("/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw", "/camera//image_rect_raw"),
        ("/image_l/x", "/image_r/x", "/image_/x"),
        ("/right/image", None, None),
        ("/leftover/image", None, None),
    ],
)
def test_names_of_right_cameras(left: str, right: str | None, common: str | None) -> None:
    assert counterpart(left) == (None if right is None else (right, common))


def test_nearest_images_within_the_tolerance_are_pairs() -> None:
    left_ns = np.array([0, 100, 200, 300], np.int64) * 1_000_000
    right_ns = np.array([1, 2, 104, 300 + PAIR_TOLERANCE_NS // 1_000_000 + 1], np.int64) * 1_000_000
    np.testing.assert_array_equal(matched_stamps(left_ns, right_ns), [[0, 0], [1, 2]])


def test_repeated_and_unordered_stamps_give_each_image_one_partner() -> None:
    left_ns = np.array([5, 5, 0], np.int64) * 10**9
    right_ns = np.array([0, 5, 5], np.int64) * 10**9
    np.testing.assert_array_equal(matched_stamps(left_ns, right_ns), [[0, 1], [2, 0]])
    assert matched_stamps(left_ns, right_ns[:0]).shape == (0, 2)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import cv2
import numpy as np
import pytest

from cdff_core.imaging.stereo_consistency import (
    MAX_ROW_ERROR_PX,
    MIN_AGREEMENT,
    StereoConsistency,
    stereo_consistency,
)
from tests.support.corridor import SHAPE, texture

DISPARITY_PX = 12


def consistency(row_offset_px: float = 0.0, shift_px: int = DISPARITY_PX) -> StereoConsistency:
    """Return the test of a wall whose right image is too low, with stated disparities of 12 px."""
    image = np.clip(texture(3, 512), 0, 255).astype(np.uint8)
    rows, columns = SHAPE
    left, right = (image[:rows, start : start + columns] for start in (0, shift_px))
    warp = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, row_offset_px]])
    lower = cv2.warpAffine(right, warp, (columns, rows), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return stereo_consistency(left, np.asarray(lower, np.uint8), np.full(SHAPE, DISPARITY_PX, np.float32))


def test_a_rectified_pair_agrees_with_its_disparities() -> None:
    result = consistency()
    assert result.agreement > 0.7
    assert result.row_error_px < 0.1
    assert not result.failures()
    assert not result.deficiencies()


@pytest.mark.parametrize("offset_px", [0.5, 1.0, -1.0, 2.0])
def test_the_row_error_is_measured_and_reported_before_disparities_are_biased_by_three_sigmas(
    offset_px: float,
) -> None:
    result = consistency(offset_px)
    assert result.row_error_px == pytest.approx(abs(offset_px), abs=0.1)
    is_reported = any(reason.startswith("row_error") for reason in result.deficiencies())
    assert is_reported == (abs(offset_px) > MAX_ROW_ERROR_PX)


def test_disparities_of_another_scene_are_a_mismatch() -> None:
    result = consistency(shift_px=200)
    assert result.agreement < MIN_AGREEMENT
    assert result.failures()[0].startswith("stereo_mismatch")


def test_little_agreement_together_with_a_row_error_is_a_mismatch_but_neither_alone() -> None:
    assert StereoConsistency(400, 0.25, 0.9).failures()
    assert not StereoConsistency(400, 0.25, 0.2).failures()
    assert not StereoConsistency(400, 0.8, 0.9).failures()


@pytest.mark.parametrize("shape", [(240, 320), (8, 320)])
def test_an_image_without_corners_is_reported_as_untested(shape: tuple[int, int]) -> None:
    flat = np.full(shape, 90, np.uint8)
    result = stereo_consistency(flat, flat, np.zeros(shape, np.float32))
    assert result.deficiencies() == ["untested_pair:0<20"]
    assert not result.failures()
    assert not result.metrics()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of the rectification are estimated from a pair and removed from its right image."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_core.stereo_odometry.right_image_correction import RightImageCorrection
from cdff_core.stereo_odometry.stereo_view import StereoView
from tests.support.corridor import CAMERA, SHAPE, drive, stereo_pair

ROW_OFFSET_PX, ROTATION_PX = 0.3, 3.0
NAMES = {
    "extraction": "features_extraction_2d",
    "stereo_matching": "stereo_matching_2d",
    "refinement": "rectification_refinement",
}


@pytest.fixture(scope="module")
def exact() -> StereoView:
    return StereoView.from_sample(Sample("stereo", 0, 0, stereo_pair(drive(1)[0], 0), id="pair"))


def make_correction() -> RightImageCorrection:
    dfns = {dfn_id: Registry.default().make_dfn(name) for dfn_id, name in NAMES.items()}
    for dfn in dfns.values():
        dfn.configure(None)
    return RightImageCorrection(dfns.__getitem__)


def rotated(view: StereoView) -> StereoView:
    """Return the view with a right image as after an error of the rotation about the vertical."""
    u, v = np.meshgrid(np.arange(SHAPE[1], dtype=np.float32), np.arange(SHAPE[0], dtype=np.float32))
    x, y = (u - CAMERA[0, 2]) / CAMERA[0, 0], (v - CAMERA[1, 2]) / CAMERA[1, 1]
    columns = u - ROTATION_PX * x**2
    rows = v - ROW_OFFSET_PX - ROTATION_PX * x * y
    maps = np.asarray(columns, np.float32), np.asarray(rows, np.float32)
    return replace(view, right=cv2.remap(view.right, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))


def difference(first: StereoView, second: StereoView) -> float:
    """Return the standard deviation of the differences of grey levels away from the border."""
    inner = np.s_[12:-12, 12:-12]
    return float(np.std(first.right[inner].astype(float) - second.right[inner]))


def test_row_and_column_offsets_of_a_rotated_right_camera_are_removed(exact: StereoView) -> None:
    view, correction = rotated(exact), make_correction()
    correction.update(view)
    assert correction.row_offset_px == pytest.approx(ROW_OFFSET_PX, abs=0.05)
    assert difference(correction.apply(view), exact) < 0.5 * difference(view, exact)


def test_a_rectified_right_image_is_not_resampled(exact: StereoView) -> None:
    correction = make_correction()
    correction.update(exact)
    assert difference(correction.apply(exact), exact) < 0.5


def test_images_without_matches_do_not_change_the_correction(exact: StereoView) -> None:
    correction = make_correction()
    correction.update(replace(exact, right=np.full(SHAPE, 90, np.uint8)))
    assert correction.row_offset_px == 0.0
    assert correction.apply(exact) is exact

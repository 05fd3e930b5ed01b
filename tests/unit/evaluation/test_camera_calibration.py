# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""OpenCV calibrates the corners that ``cdff calibrate`` is compared on."""

from __future__ import annotations

import pytest

from evaluation.camera_calibration import BOARDS, CAMERAS, _opencv, camera_views


@pytest.mark.parametrize("lens", ["pinhole", "fisheye"])
def test_opencv_calibrates_the_corners(lens: str) -> None:
    truth = CAMERAS[lens]
    estimate = _opencv(camera_views(truth, BOARDS["charuco"], 1, images=8), truth)
    assert estimate is not None
    assert estimate.lens == lens
    assert estimate.fx == pytest.approx(truth.fx, rel=0.01)


@pytest.mark.parametrize("lens", ["fov", "division"])
def test_a_lens_that_opencv_does_not_have_is_not_compared(lens: str) -> None:
    assert _opencv([], CAMERAS[lens]) is None

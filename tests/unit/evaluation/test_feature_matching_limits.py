# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import cv2
import numpy as np
import pytest

from cdff_core.imaging.two_view import transfer
from evaluation.feature_matching_limits import CHANGES, COLS, ROWS, changed_view


@pytest.mark.parametrize("change", CHANGES)
def test_the_homography_maps_points_to_the_changed_image(change: str) -> None:
    image = np.zeros((ROWS, COLS), np.uint8)
    cv2.circle(image, (250, 130), 12, 255, -1)
    changed, H = changed_view(image, change, CHANGES[change][1][0])
    rows, cols = np.nonzero(changed > 0.6 * changed.max())
    assert [np.median(cols), np.median(rows)] == pytest.approx(
        transfer(H, np.array([[250.0, 130.0]]))[0], abs=1.5
    )

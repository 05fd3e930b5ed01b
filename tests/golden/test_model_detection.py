# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The milk carton of PCL's tutorial is found once, and not in an image without it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from evaluation import model_detection

pytestmark = [pytest.mark.golden, pytest.mark.slow]


def test_the_milk_carton_is_found_at_the_pose_of_the_tutorial_only(
    real_data: Callable[[str], Path],
) -> None:
    result = model_detection.pcl(real_data("pcl_recognition").parent)
    assert result["detections"] == 1
    assert result["add_of_diameter"] < 0.02  # 0.009; the pose of the tutorial is not refined
    assert result["wrong_without"] == 0

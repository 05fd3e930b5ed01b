# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Relative pose of the cameras of a stereo pair from the calibrations of ROS, compared with OpenCV."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from cdff_common.geometry import se3
from services.ros_messages.stereo_cameras import pose_of_calibrations
from services.ros_messages.topics import Topic

K = np.array([[400.0, 0.0, 320.0], [0.0, 400.0, 240.0], [0.0, 0.0, 1.0]])
T_RIGHT_LEFT = se3.transform(se3.exp_so3([0.02, -0.03, 0.01]), [-0.25, 0.01, 0.005])


def cameras(name: str, **changes: Any) -> tuple[Topic, Topic]:
    """Return both topics with the R and P that OpenCV computes for ``T_RIGHT_LEFT``."""
    R1, R2, P1, P2, *_ = cv2.stereoRectify(
        K, np.zeros(5), K, np.zeros(5), (640, 480), T_RIGHT_LEFT[:3, :3], T_RIGHT_LEFT[:3, 3:]
    )
    infos = [SimpleNamespace(r=R.ravel(), p=P.ravel()) for R, P in ((R1, P1), (R2, P2))]
    for info in infos:
        vars(info).update(changes)
    conversion: Any = None
    left, right = (Topic(f"/{s}/{name}", "mana", conversion, i) for s, i in zip("lr", infos, strict=True))
    return left, right


def test_the_pose_of_images_that_are_not_rectified_is_that_of_the_calibration() -> None:
    np.testing.assert_allclose(pose_of_calibrations(*cameras("image_raw")), T_RIGHT_LEFT, atol=1e-9)


def test_the_pose_of_rectified_images_is_the_baseline_along_x() -> None:
    baseline_m = float(np.linalg.norm(T_RIGHT_LEFT[:3, 3]))
    expected = se3.transform(np.eye(3), [-baseline_m, 0.0, 0.0])
    np.testing.assert_allclose(pose_of_calibrations(*cameras("image_rect")), expected, atol=1e-9)


@pytest.mark.parametrize("p", [np.column_stack([K, np.zeros(3)]).ravel(), np.zeros(12), np.zeros(5)])
def test_a_calibration_without_a_baseline_has_no_pose(p: Any) -> None:
    assert pose_of_calibrations(*cameras("image_raw", p=p)) is None

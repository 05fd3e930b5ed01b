# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""AprilTags in real images: motions of the camera against a bundle adjustment of the same tags by others.

The sheet of tags is not flat to better than 0.6 px, and the images of fast motions are blurred.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.camera import CameraModel
from cdff_common.geometry import se3
from cdff_core.calibration.adjustment import View
from cdff_core.calibration.assessment import judged
from cdff_core.calibration.board_poses import board_poses_of
from cdff_core.calibration.boards import Board
from cdff_core.calibration.rig import calibrate_rig

BOARD = Board("tags", 4, 3, 0.092, 0.26)
CAMERA = CameraModel(480, 640, 607.178, 607.234, 321.391, 241.918, ())


@pytest.fixture
def folder(real_data: Callable[[str], Path]) -> Path:
    return real_data("visp_rbt_rgbd")


@pytest.fixture
def views(folder: Path) -> list[View]:
    found = []
    for path in sorted((folder / "color").glob("*.png")):
        numbers, pixels = BOARD.detect(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))
        if len(numbers):
            found.append(View(0, int(path.stem), BOARD.corners_m[numbers], pixels, numbers))
    return found


def test_the_motions_of_the_camera_are_those_of_the_reference(folder: Path, views: list[View]) -> None:
    assert len(views) == 24
    poses = board_poses_of(CAMERA, views)
    assert len(poses) == 24
    assert np.median([pose.rms_px for pose in poses]) < 0.8
    rows = np.loadtxt(folder / "camera_from_board.csv", delimiter=",", skiprows=1)
    reference = {int(row[0]): np.vstack([row[1:].reshape(3, 4), [0.0, 0.0, 0.0, 1.0]]) for row in rows}
    T = np.array([pose.T_camera_board for pose in poses])
    T_reference = np.array([reference[pose.number] for pose in poses])
    own, expected = T[1:] @ se3.inverse(T[0]), T_reference[1:] @ se3.inverse(T_reference[0])
    angles = se3.rotation_angle(np.swapaxes(own[:, :3, :3], 1, 2) @ expected[:, :3, :3])
    distances = np.linalg.norm(own[:, :3, 3] - expected[:, :3, 3], axis=1)
    assert np.rad2deg(np.median(angles)) < 0.35
    assert np.median(distances) < 0.006


def test_a_board_that_is_not_tilted_is_not_called_a_good_calibration(views: list[View]) -> None:
    assessment = judged(calibrate_rig(views, [(480, 640)]))
    assert not assessment.is_good
    assert any("tilt the board more" in sentence for sentence in assessment.sentences)
    assert any("of the image: move it into the lower" in sentence for sentence in assessment.sentences)

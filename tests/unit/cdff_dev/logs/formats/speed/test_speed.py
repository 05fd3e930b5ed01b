# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Labelled images of SPEED and SPEED+ are read as logs."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_dev.logs import open_log

CAMERA = {
    "Nu": 64,
    "Nv": 48,
    "cameraMatrix": [[60.0, 0.0, 32.0], [0.0, 60.0, 24.0], [0.0, 0.0, 1.0]],
    "distCoeffs": [0.0, 0.0, 0.0, 0.0, 0.0],
}


@pytest.fixture
def lightbox(tmp_path: Path) -> Path:
    folder = tmp_path / "lightbox"
    (folder / "images").mkdir(parents=True)
    (tmp_path / "camera.json").write_text(json.dumps(CAMERA), encoding="utf-8")
    labels = []
    for n in (1, 2, 3):
        name = f"img{n:06d}.jpg"
        if n < 3:
            cv2.imwrite(str(folder / "images" / name), np.full((48, 64), n, np.uint8))
        pose = {"q_vbs2tango_true": [0.0, 0.0, 0.0, 1.0], "r_Vo2To_vbs_true": [0.1, 0.2, 5.0 + n]}
        labels.append({"filename": name, **pose})
    (folder / "test.json").write_text(json.dumps(labels), encoding="utf-8")
    return folder


def test_images_have_the_pose_of_the_target_in_the_camera(lightbox: Path) -> None:
    log = open_log(lightbox)
    poses = [s.value.transform.matrix for s in log.samples(["/speed/truth.target"])]
    np.testing.assert_allclose([T[:3, 3] for T in poses], [[0.1, 0.2, 6.0], [0.1, 0.2, 7.0]])
    np.testing.assert_allclose(poses[0][:3, :3], np.diag([-1.0, -1.0, 1.0]), atol=1e-12)
    frame = next(s.value for s in log.samples(["/speed/camera.frame"]))
    assert frame.camera_matrix[0, 0] == 60.0
    assert log.unconverted["labels"].count == 1


@pytest.mark.parametrize("name", ["../secret.jpg", 5])
def test_labels_with_other_names_are_refused(lightbox: Path, name: object) -> None:
    (lightbox / "test.json").write_text(json.dumps([{"filename": name}]), encoding="utf-8")
    with pytest.raises(InputError, match=r"test\.json: .*expected labels of SPEED"):
        open_log(lightbox)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scenes of the BOP benchmark are read as logs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_dev.logs import open_log

K = [500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """Two images with two objects; the first image has two instances of object 5."""
    for name, image in (
        ("rgb", np.zeros((480, 640, 3), np.uint8)),
        ("depth", np.full((480, 640), 50, np.uint16)),
    ):
        (tmp_path / name).mkdir()
        for n in (0, 3):
            cv2.imwrite(str(tmp_path / name / f"{n:06d}.png"), image)
    cameras = {str(n): {"cam_K": K, "depth_scale": 0.1} for n in (0, 3)}
    (tmp_path / "scene_camera.json").write_text(json.dumps(cameras), encoding="utf-8")

    def pose(number: int, x_mm: float) -> dict[str, object]:
        return {"obj_id": number, "cam_R_m2c": list(np.eye(3).ravel()), "cam_t_m2c": [x_mm, 0.0, 900.0]}

    truth = {"0": [pose(5, 10.0), pose(5, 20.0), pose(7, 30.0)], "3": [pose(7, 40.0)]}
    (tmp_path / "scene_gt.json").write_text(json.dumps(truth), encoding="utf-8")
    return tmp_path


def test_each_object_is_a_stream_of_poses_in_metres(scene: Path) -> None:
    log = open_log(scene)
    poses = [(s.stamp_ns, s.value.transform.matrix[0, 3]) for s in log.samples(["/bop/truth.object_7"])]
    assert poses == [(0, pytest.approx(0.03)), (300_000_000, pytest.approx(0.04))]
    assert log.streams["/bop/truth.object_5"].count == 1
    assert log.unconverted["scene_gt.json"].count == 1
    depth = next(s.value for s in log.samples(["/bop/depth.depth"]))
    np.testing.assert_allclose(depth.data, 0.005)


def test_different_cameras_in_a_scene_are_refused(scene: Path) -> None:
    cameras = json.loads((scene / "scene_camera.json").read_text(encoding="utf-8"))
    cameras["3"]["cam_K"][0] = 510.0
    (scene / "scene_camera.json").write_text(json.dumps(cameras), encoding="utf-8")
    with pytest.raises(InputError, match=r"scene_camera\.json: .*2 different cameras"):
        open_log(scene)


def test_the_depth_of_a_single_frame_agrees_with_the_pose_of_its_object(
    real_data: Callable[[str], Path],
) -> None:
    samples = {s.stream: s.value for s in open_log(real_data("bop_tyol_frame")).samples()}
    assert samples["/bop/truth.object_19"].parent_frame == samples["/bop/colour.frame"].frame
    T, depth = samples["/bop/truth.object_19"].transform.matrix, samples["/bop/depth.depth"]
    x, y, z = T[:3, 3]
    column = round((x / z - depth.center_x) / depth.scale_x)
    row = round((y / z - depth.center_y) / depth.scale_y)
    assert depth.data.reshape(depth.height, depth.width)[row, column] == pytest.approx(z, abs=0.15)

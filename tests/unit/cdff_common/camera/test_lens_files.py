# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calibration files with lenses beyond the pinhole: COLMAP, camodocal, Kalibr, OpenCV and ROS."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from cdff_common.camera import CameraModel, lens_named, read_camera, read_cameras
from cdff_common.errors import InputError

COLMAP = """# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
1 SIMPLE_PINHOLE 640 480 500 320 240
2 PINHOLE 640 480 500 510 320 240
3 SIMPLE_RADIAL 640 480 500 320 240 -0.1
4 RADIAL 640 480 500 320 240 -0.1 0.02
5 OPENCV 640 480 500 510 320 240 -0.1 0.02 1e-3 -2e-3
6 OPENCV_FISHEYE 640 480 300 310 320 240 -0.01 0.02 -0.003 0.0005
7 FULL_OPENCV 640 480 500 510 320 240 0.5 -0.2 1e-4 2e-4 0.03 0.6 -0.15 0.02
8 FOV 640 480 500 510 320 240 0.9
9 SIMPLE_RADIAL_FISHEYE 640 480 300 320 240 0.02
10 DIVISION 640 480 500 510 320 240 -0.2
"""
MEI = """%YAML:1.0
---
model_type: MEI
camera_name: image_02
image_width: 1400
image_height: 1400
mirror_parameters:
   xi: 2.2134047507854890e+00
distortion_parameters:
   k1: 1.6798235660113681e-02
   k2: 1.6548773243373522e+00
   p1: 4.2223943394772046e-04
   p2: 4.2462134260997584e-04
projection_parameters:
   gamma1: 1.3363220825849971e+03
   gamma2: 1.3357883350012958e+03
   u0: 7.1694323510126321e+02
   v0: 7.0576498308221585e+02
"""
KANNALA_BRANDT = """
model_type: KANNALA_BRANDT
image_width: 752
image_height: 480
projection_parameters: {k2: -0.01, k3: 0.02, k4: -0.003, k5: 0.0005, mu: 460, mv: 461, u0: 370, v0: 250}
"""
KALIBR = """
cam0:
  camera_model: omni
  distortion_model: radtan
  distortion_coeffs: [-0.3, 0.06, 0.0002, 1.7e-05]
  intrinsics: [1.4, 1020.0, 1021.0, 367.2, 248.4]
  resolution: [752, 480]
cam1:
  camera_model: pinhole
  distortion_model: fov
  distortion_coeffs: [0.92]
  intrinsics: [400.0, 401.0, 367.2, 248.4]
  resolution: [752, 480]
"""


@pytest.fixture
def file(tmp_path: Path) -> Callable[[str], Path]:
    """A function that writes a text to a file and returns its path."""

    def write(text: str) -> Path:
        (tmp_path / "calibration").write_text(text)
        return tmp_path / "calibration"

    return write


def test_the_cameras_of_colmap_have_the_first_pixel_at_zero(file: Callable[[str], Path]) -> None:
    cameras, poses = read_cameras(file(COLMAP))
    assert not poses
    assert [cameras[str(n)].lens for n in (1, 5, 6, 8, 9, 10)] == [
        "pinhole",
        "pinhole",
        "fisheye",
        "fov",
        "fisheye",
        "division",
    ]
    assert all((c.cols, c.rows, c.cx, c.cy) == (640, 480, 319.5, 239.5) for c in cameras.values())
    assert cameras["3"].distortion == (-0.1, 0.0, 0.0, 0.0)
    assert (cameras["3"].fx, cameras["3"].fy, cameras["10"].fy) == (500.0, 500.0, 510.0)
    assert len(cameras["7"].distortion) == 8


def test_the_binary_cameras_of_colmap_equal_those_of_the_text(file: Callable[[str], Path]) -> None:
    path = file(COLMAP).with_name("cameras.bin")
    data = struct.pack("<QIiQQ4d", 2, 2, 1, 640, 480, 500, 510, 320, 240)
    path.write_bytes(data + struct.pack("<IiQQ5d", 10, 13, 640, 480, 500, 510, 320, 240, -0.2))
    of_text = read_cameras(file(COLMAP))[0]
    assert read_cameras(path)[0] == {name: of_text[name] for name in ("2", "10")}
    for damaged in (data, data[:-1], data.replace(struct.pack("<i", 1), struct.pack("<i", 99), 1), b""):
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"cameras\.bin"):
            read_cameras(path)


def test_the_cameras_of_camodocal_are_read(file: Callable[[str], Path]) -> None:
    mirror = read_camera(file(MEI))
    assert (mirror.lens, mirror.rows, mirror.fx) == ("omnidirectional", 1400, 1336.3220825849971)
    assert mirror.distortion[0] == 2.213404750785489
    fisheye = read_camera(file(KANNALA_BRANDT))
    assert (fisheye.lens, fisheye.fy, fisheye.distortion) == ("fisheye", 461.0, (-0.01, 0.02, -0.003, 0.0005))


def test_the_omnidirectional_and_fov_cameras_of_kalibr_are_read(file: Callable[[str], Path]) -> None:
    cameras, _ = read_cameras(file(KALIBR))
    assert (cameras["cam0"].lens, cameras["cam0"].fx) == ("omnidirectional", 1020.0)
    assert cameras["cam0"].distortion == (1.4, -0.3, 0.06, 0.0002, 1.7e-05)
    assert (cameras["cam1"].lens, cameras["cam1"].distortion) == ("fov", (0.92,))
    # The equations of aslam_cv's OmniProjection and FovDistortion, written out.
    p = np.array([0.4, -0.3, 1.0])
    mx, my = p[:2] / (p[2] + 1.4 * np.linalg.norm(p))
    r2 = mx * mx + my * my
    u = mx * (1 - 0.3 * r2 + 0.06 * r2**2) + 2 * 0.0002 * mx * my + 1.7e-05 * (r2 + 2 * mx * mx)
    assert cameras["cam0"].project(p)[0, 0] == pytest.approx(1020.0 * u + 367.2)
    radius = np.hypot(0.4, 0.3)
    scale = np.arctan(2 * radius * np.tan(0.46)) / (radius * 0.92)
    assert cameras["cam1"].project(p)[0, 0] == pytest.approx(400.0 * 0.4 * scale + 367.2)


def test_an_omnidirectional_calibration_written_by_opencv_is_read(tmp_path: Path) -> None:
    storage = cv2.FileStorage(str(tmp_path / "c.yml"), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", 640), ("image_height", 480), ("xi", 1.2)):
        storage.write(name, value)
    storage.write("camera_matrix", np.array([[500.0, 0.0, 320.0], [0.0, 501.0, 240.0], [0.0, 0.0, 1.0]]))
    storage.write("distortion_coefficients", np.array([[-0.2, 0.05, 0.001, 0.002]]))
    storage.release()
    camera = read_camera(tmp_path / "c.yml")
    assert (camera.lens, camera.distortion) == ("omnidirectional", (1.2, -0.2, 0.05, 0.001, 0.002))


CAMERA_INFO = """
image_width: 640
image_height: 480
camera_name: left
camera_matrix: {rows: 3, cols: 3, data: [300, 0, 320, 0, 301, 240, 0, 0, 1]}
distortion_model: MODEL
distortion_coefficients: {rows: 1, cols: 4, data: [-0.01, 0.02, -0.003, 0.0005]}
"""


@pytest.mark.parametrize(
    ("model", "lens"), [("plumb_bob", "pinhole"), ("equidistant", "fisheye"), ("fisheye", "fisheye")]
)
def test_the_distortion_model_of_a_ros_camera_info_is_used(
    file: Callable[[str], Path], model: str, lens: str
) -> None:
    assert read_camera(file(CAMERA_INFO.replace("MODEL", model))).lens == lens


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (CAMERA_INFO.replace("MODEL", "double_sphere"), "'double_sphere': expected"),
        (CAMERA_INFO.replace("MODEL", "fov") + "xi: 1.0\n", "one lens model"),
        (COLMAP.replace("FOV", "THIN_PRISM_FISHEYE"), "THIN_PRISM_FISHEYE"),
        (COLMAP.replace(" -0.2\n", "\n"), "4 parameters: expected 5"),
        (MEI.replace("MEI", "SCARAMUZZA"), "SCARAMUZZA"),
        (MEI.replace("xi:", "chi:"), "xi"),
        (KALIBR.replace("[1.4, ", "["), "4 intrinsics of omni"),
    ],
)
def test_an_unknown_lens_is_refused_with_the_reason(
    file: Callable[[str], Path], text: str, reason: str
) -> None:
    with pytest.raises(InputError, match=reason):
        read_cameras(file(text))


def test_names_of_lenses_are_read_in_any_case() -> None:
    assert lens_named("MEI") == "omnidirectional"
    assert lens_named("Kannala_Brandt") == "fisheye"


def test_the_images_of_a_ros_topic_have_its_fisheye_lens() -> None:
    from services.ros_messages.images import _calibration, camera_model

    info = SimpleNamespace(
        height=480,
        width=640,
        distortion_model="equidistant",
        k=[300, 0, 320, 0, 301, 240, 0, 0, 1],
        d=[-0.01, 0.02, -0.003, 0.0005],
        p=[300, 0, 320, 0, 0, 301, 240, 0, 0, 0, 1, 0],
    )
    topic: Any = SimpleNamespace(camera=info, name="/left", is_rectified=False)
    assert camera_model(topic) == CameraModel(
        480, 640, 300.0, 301.0, 320.0, 240.0, (-0.01, 0.02, -0.003, 0.0005), "fisheye"
    )
    _, coefficients, model = _calibration(topic)
    assert model is camera_model(topic).message_model
    assert coefficients.tolist() == info.d

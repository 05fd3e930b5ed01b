# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Calibration files of OpenCV, Kalibr and KITTI."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.camera import read_camera, read_stereo
from cdff_common.errors import InputError

KALIBR = """
cam0:
  camera_model: pinhole
  distortion_model: radtan
  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.7e-05]
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.11]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_model: equidistant
  distortion_coeffs: [-0.01, 0.02, -0.003, 0.0005]
  intrinsics: [457.6, 456.1, 379.9, 255.2]
  resolution: [752, 480]
"""
KITTI_RAW = """calib_time: 09-Jan-2012 13:57:47
corner_dist: 9.950000e-02
S_00: 1.392000e+03 5.120000e+02
K_00: 9.842439e+02 0.0 6.900000e+02 0.0 9.808141e+02 2.331966e+02 0.0 0.0 1.0
D_00: -3.728755e-01 2.037299e-01 2.219027e-03 1.383707e-03 -7.233722e-02
R_00: 1.0 0.0 0.0 0.0 1.0 0.0 0.0 0.0 1.0
T_00: 2.573699e-16 -1.059758e-16 1.614870e-16
S_01: 1.392000e+03 5.120000e+02
K_01: 9.895267e+02 0.0 7.020000e+02 0.0 9.878386e+02 2.455590e+02 0.0 0.0 1.0
D_01: -3.644661e-01 1.790019e-01 1.148107e-03 -6.298563e-04 -5.314062e-02
R_01: 0.9993513 0.01860866 -0.03083487 -0.01887662 0.9997863 -0.008421873 0.03067156 0.008998467 0.999489
T_01: -5.370000e-01 4.822061e-03 -1.252488e-02
"""


@pytest.fixture
def file(tmp_path: Path) -> Callable[[str], Path]:
    """A function that writes a text to a file and returns its path."""

    def write(text: str) -> Path:
        (tmp_path / "calibration").write_text(text)
        return tmp_path / "calibration"

    return write


def test_a_rovers_opencv_file_is_read(real_data: Callable[[str], Path]) -> None:
    path = next(real_data("cdff_upstream/MinnieStereo").glob("*.yml"))
    stereo = read_stereo(path)
    assert (stereo.left.rows, stereo.left.cols) == (1200, 1920)
    assert stereo.left.distortion[0] == -0.221269881741857
    assert stereo.baseline_m == pytest.approx(0.27028, abs=1e-5)
    assert stereo.T_right_left[0, 3] == -0.270268442641143
    assert read_camera(path, "2").fx == 1066.44771376037


@pytest.mark.req("CDFF-CORE-094")
def test_a_calibration_written_by_opencv_is_read(tmp_path: Path) -> None:
    K, D = (
        np.array([[500.0, 0.0, 320.0], [0.0, 501.0, 240.0], [0.0, 0.0, 1.0]]),
        np.array([[-0.2, 0.05, 0.0, 0.0, 0.01]]),
    )
    storage = cv2.FileStorage(str(tmp_path / "c.yml"), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", 640), ("image_height", 480), ("camera_matrix", K)):
        storage.write(name, value)
    storage.write("distortion_coefficients", D)
    storage.release()
    camera = read_camera(tmp_path / "c.yml")
    assert (camera.rows, camera.cols, camera.fy, camera.distortion) == (480, 640, 501.0, tuple(D[0]))


@pytest.mark.req("CDFF-CORE-094")
def test_a_kalibr_chain_is_read(file: Callable[[str], Path]) -> None:
    stereo = read_stereo(file(KALIBR))
    assert (stereo.left.lens, stereo.right.lens) == ("pinhole", "fisheye")
    assert stereo.T_right_left[:3, 3] == pytest.approx([-0.11, 0.0, 0.0])
    assert (stereo.left.cols, stereo.left.rows, stereo.right.cx) == (752, 480, 379.9)


def test_kittis_projection_matrices_are_read(real_data: Callable[[str], Path]) -> None:
    stereo = read_stereo(real_data("kitti_stereo/KITTI_sequence_1") / "calib_kitti.txt")
    assert stereo.is_rectified
    assert stereo.baseline_m == pytest.approx(379.8145 / 707.0912)


@pytest.mark.req("CDFF-CORE-094")
def test_kittis_raw_calibration_is_read(file: Callable[[str], Path]) -> None:
    stereo = read_stereo(file(KITTI_RAW))
    assert stereo.left.distortion[4] == -7.233722e-02
    assert (stereo.left.rows, stereo.left.cols) == (512, 1392)
    assert stereo.baseline_m == pytest.approx(0.537168, abs=1e-6)
    assert not stereo.is_rectified


def test_rectified_kitti_cameras_are_read_with_and_without_the_raw_ones(file: Callable[[str], Path]) -> None:
    rectified = (
        "S_rect_00: 1.242e+03 3.75e+02\nP_rect_00: 721.5 0 609.6 0 0 721.5 172.9 0 0 0 1 0\n"
        "S_rect_01: 1.242e+03 3.75e+02\nP_rect_01: 721.5 0 609.6 -387.6 0 721.5 172.9 0 0 0 1 0\n"
    )
    for text in (rectified, KITTI_RAW + rectified):
        stereo = read_stereo(file(text), "rect_00", "rect_01")
        assert stereo.is_rectified
        assert stereo.baseline_m == pytest.approx(387.6 / 721.5)
        assert (stereo.left.cols, stereo.left.rows) == (1242, 375)
    assert read_camera(file(KITTI_RAW + rectified)).distortion


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("just words", "expected"),
        ("a: &a [1]\nb: *a", "aliases"),
        ("camera_model: x", "none of"),
        (KALIBR.replace("pinhole", "omni", 1), "4 intrinsics of omni"),
        (KALIBR.replace("pinhole", "eucm", 1), "eucm with radtan"),
        (KALIBR.replace("[458.6, ", "["), "ValueError"),
        (KITTI_RAW.replace("K_01: 9.895267e+02", "K_01: nan"), "finite"),
        ("camera_matrix: !!python/object:os.system {}", "not YAML"),
        ("[" * 5000, "not YAML"),
    ],
)
def test_an_invalid_calibration_is_refused_with_the_reason(
    file: Callable[[str], Path], text: str, reason: str
) -> None:
    with pytest.raises(InputError, match=reason):
        read_stereo(file(text))


def test_a_missing_camera_and_a_camera_without_pose_are_named_in_the_error(
    file: Callable[[str], Path],
) -> None:
    with pytest.raises(InputError, match="cam7"):
        read_camera(file(KALIBR), "cam7")
    unlinked = file(KALIBR.replace("  T_cn_cnm1:", "  T_unknown:"))
    assert read_camera(unlinked, "cam1").lens == "fisheye"
    with pytest.raises(InputError, match="no pose of camera 'cam1'"):
        read_stereo(unlinked)


def chain(*links: bool) -> str:
    """Return a Kalibr chain; each entry states if that camera has a pose relative to the previous one."""
    camera = KALIBR[KALIBR.index("cam1:") :]
    first = "cam0:\n" + camera[camera.index("  camera_model") :]
    further_cameras = (camera.replace("cam1", f"cam{n}") for n in range(1, len(links) + 1))
    return first + "".join(
        text if is_linked else text.replace("T_cn_cnm1", "T_unknown")
        for text, is_linked in zip(further_cameras, links, strict=True)
    )


@pytest.mark.req("CDFF-CORE-094")
def test_cameras_after_a_missing_link_of_a_kalibr_chain_have_no_pose(file: Callable[[str], Path]) -> None:
    assert read_stereo(file(chain(True, True)), "cam0", "cam2").baseline_m == pytest.approx(0.22)
    broken = file(chain(False, True))
    assert read_camera(broken, "cam2").lens == "fisheye"
    for right in ("cam1", "cam2"):
        with pytest.raises(InputError, match=f"no pose of camera '{right}'.*cam0$"):
            read_stereo(broken, "cam0", right)
    without_cam1 = file(chain(True, True).replace("cam1:", "other:"))
    with pytest.raises(InputError, match="no pose of camera 'cam2'"):
        read_stereo(without_cam1, "cam0", "cam2")

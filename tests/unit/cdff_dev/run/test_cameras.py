# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff run`` on images with the calibration files of their cameras."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from cdff_common.camera import read_camera, read_stereo
from cdff_common.cli import run_safely
from cdff_common.codecs.json_form import from_json
from cdff_common.errors import InputError
from cdff_common.formats.image import read_image, write_png
from cdff_common.interfaces.description import Port
from cdff_core.imaging import rectification
from cdff_dev.run import commands
from cdff_dev.run.inputs import read_inputs

RealData = Callable[[str], Path]
SHAPE = (96, 128)
K1 = [[80.0, 0.0, 64.0], [0.0, 81.0, 47.0], [0.0, 0.0, 1.0]]
K2 = [[79.0, 0.0, 63.0], [0.0, 80.0, 48.5], [0.0, 0.0, 1.0]]
D1, D2 = (-0.2, 0.05, 1e-4, -2e-4), (-0.21, 0.06, -1e-4, 1e-4)
IMAGE = Port(name="image", type="Frame")
PAIR = Port(name="pair", type="FramePair")


def cdff_run(*arguments: str | Path) -> int:
    parser = argparse.ArgumentParser()
    commands.register(parser.add_subparsers())
    parsed = parser.parse_args(["run", *map(str, arguments)])
    return run_safely(lambda: int(parsed.run(parsed)))


def report_of(folder: Path) -> Any:
    return json.loads((folder / "outputs.json").read_text())


def opencv(path: Path) -> None:
    storage = cv2.FileStorage(f"{path}.yml", cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", SHAPE[1])
    storage.write("image_height", SHAPE[0])
    for name, value in (
        ("M1", K1),
        ("D1", [D1]),
        ("M2", K2),
        ("D2", [D2]),
        ("R", np.eye(3)),
        ("T", [[-0.1], [0.0], [0.0]]),
    ):
        storage.write(name, np.array(value))
    storage.release()
    Path(f"{path}.yml").rename(path)


def kalibr(path: Path, model: str = "radtan") -> None:
    text = ""
    for name, K, D in (("cam0", K1, D1), ("cam1", K2, D2)):
        text += (
            f"{name}:\n  camera_model: pinhole\n  distortion_model: {model}\n  distortion_coeffs: {list(D)}\n"
        )
        text += f"  intrinsics: [{K[0][0]}, {K[1][1]}, {K[0][2]}, {K[1][2]}]\n"
        text += f"  resolution: [{SHAPE[1]}, {SHAPE[0]}]\n"
    path.write_text(text + "  T_cn_cnm1: [[1, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n")


def kalibr_fisheye(path: Path) -> None:
    kalibr(path, "equidistant")


def kitti(path: Path) -> None:
    lines = []
    for name, K, D, x in (("00", K1, D1, 0.0), ("01", K2, D2, -0.1)):
        fields: dict[str, Any] = {
            "S": [SHAPE[1], SHAPE[0]],
            "K": np.ravel(K),
            "D": [*D, 0.01],
            "R": np.eye(3).ravel(),
        }
        lines += [f"{k}_{name}: {' '.join(map(str, v))}" for k, v in (fields | {"T": [x, 0.0, 0.0]}).items()]
    path.write_text("\n".join(lines) + "\n")


#: For each kind of calibration file: its writer, and the name of the second camera.
KINDS: dict[str, tuple[Callable[[Path], None], str]] = {
    "opencv": (opencv, "2"),
    "kalibr": (kalibr, "cam1"),
    "kalibr_fisheye": (kalibr_fisheye, "cam1"),
    "kitti": (kitti, "01"),
}


@pytest.fixture
def images(tmp_path: Path, rng: np.random.Generator) -> tuple[Path, Path]:
    for name in ("left", "right"):
        (tmp_path / name).write_bytes(write_png(rng.integers(0, 255, SHAPE).astype(np.uint8)))
    return tmp_path / "left", tmp_path / "right"


@pytest.mark.req("CDFF-CORE-094")
@pytest.mark.parametrize("kind", KINDS)
def test_an_image_is_undistorted_by_the_camera_of_any_calibration_file(
    tmp_path: Path, images: tuple[Path, Path], kind: str
) -> None:
    write, second = KINDS[kind]
    write(tmp_path / "camera")
    for name, of_file in (("", images[0]), (second, images[1])):
        image = f"image={of_file},{tmp_path / 'camera'}" + (f",{name}" if name else "")
        assert cdff_run("image_undistortion", image, "--set", "keep=0.5", "--out", tmp_path / "out") == 0
        ideal = rectification.undistorted(read_camera(tmp_path / "camera", name), 0.5)
        np.testing.assert_array_equal(
            read_image(tmp_path / "out/image.png"), ideal.apply(read_image(of_file))
        )
        # The camera is written to a separate file, since an image file cannot contain it.
        camera_file = tmp_path / "out" / report_of(tmp_path / "out")["outputs"]["image"]["camera"]
        assert read_camera(camera_file) == ideal.camera


@pytest.mark.req("CDFF-CORE-094")
@pytest.mark.parametrize("kind", KINDS)
def test_a_pair_is_rectified_by_the_cameras_of_any_calibration_file(
    tmp_path: Path, images: tuple[Path, Path], kind: str
) -> None:
    KINDS[kind][0](tmp_path / "camera")
    files = f"pair={images[0]},{images[1]},{tmp_path / 'camera'}"
    assert cdff_run("stereo_rectification", files, "--set", "keep=0.5", "--out", tmp_path / "out") == 0
    pair = from_json("FramePair", json.loads((tmp_path / "out/pair.json").read_text()))
    left, right, baseline_m = rectification.rectified(read_stereo(tmp_path / "camera"), 0.5)
    assert pair.baseline == pytest.approx(baseline_m)
    for image, ideal, file in ((pair.left, left, images[0]), (pair.right, right, images[1])):
        np.testing.assert_allclose(image.camera_matrix, ideal.camera.matrix)
        np.testing.assert_array_equal(image.image, ideal.apply(read_image(file)))
    # The output can be used as an input.
    assert (
        cdff_run("stereo_degradation", f"pair={tmp_path / 'out/pair.json'}", "--out", tmp_path / "small") == 0
    )


@pytest.mark.parametrize(
    ("name", "inputs"),
    [
        ("visual_odometry_sparse", ["stereo={l},{r},{c}"]),
        ("triangulation", ["stereo={l},{r},{c}"]),
        ("feature_matching", ["left={l},{c},cam0", "right={r},{c},cam1"]),
        ("disparity_image", ["left={l},{c},cam0", "right={r},{c},cam1"]),
    ],
)
def test_a_dfn_for_pinhole_images_refuses_a_distorted_image(
    tmp_path: Path,
    images: tuple[Path, Path],
    name: str,
    inputs: list[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    kalibr(tmp_path / "camera")
    inputs_of_files = [text.format(l=images[0], r=images[1], c=tmp_path / "camera") for text in inputs]
    assert cdff_run(name, *inputs_of_files, "--out", tmp_path / "out") in (1, 3)
    assert "stereo_rectification" in capsys.readouterr().err


def test_a_real_rovers_pair_is_rectified_by_its_calibration_file(real_data: RealData, tmp_path: Path) -> None:
    folder = real_data("cdff_upstream/MinnieStereo")
    calibration = next(folder.glob("*.yml"))
    value = read_inputs(
        [PAIR], {"pair": f"{folder / 'MinnieRectLeft.png'},{folder / 'MinnieRectRight.png'},{calibration}"}
    )["pair"]
    stereo = read_stereo(calibration)
    assert value.left.intrinsic.dist_coeffs.tolist() == list(stereo.left.distortion)
    assert value.right.camera_matrix.tolist() == stereo.right.matrix.tolist()
    np.testing.assert_allclose(
        np.linalg.inv(value.right.T_robot_sensor.matrix), stereo.T_right_left, atol=1e-12
    )
    assert value.baseline == pytest.approx(0.27028, abs=1e-5)


def test_the_first_pair_of_a_recorded_drive_is_read_with_kitti_calibration(
    real_data: RealData, tmp_path: Path
) -> None:
    folder = real_data("kitti_stereo/KITTI_sequence_1")
    left, right = (folder / f"image_{side}_kitti" / "000000.png" for side in "lr")
    stereo = f"stereo={left},{right},{folder / 'calib_kitti.txt'}"
    assert cdff_run("visual_odometry_sparse", stereo, "--out", tmp_path / "out") == 0
    assert report_of(tmp_path / "out")["quality"]["metrics"]["features"] > 100


@pytest.mark.parametrize(
    "text",
    [
        '{"camera_matrix": [[80, 0, 64], [0, 80, 48], [0, 0, 1]], "baseline_m": 0.12}',
        "camera_matrix: [80, 0, 64, 0, 80, 48, 0, 0, 1]\nbaseline_m: 0.12\n",
    ],
)
def test_a_camera_matrix_with_a_baseline_is_the_calibration_of_a_rectified_pair(
    tmp_path: Path, images: tuple[Path, Path], text: str
) -> None:
    (tmp_path / "camera").write_text(text)
    pair = read_inputs([PAIR], {"pair": f"{images[0]},{images[1]},{tmp_path / 'camera'}"})["pair"]
    assert pair.baseline == 0.12
    assert pair.left.T_robot_sensor is None
    assert pair.right.camera_matrix.tolist() == [[80.0, 0.0, 64.0], [0.0, 80.0, 48.0], [0.0, 0.0, 1.0]]
    assert len(pair.left.intrinsic.dist_coeffs) == 0


@pytest.mark.parametrize(
    ("port", "files", "reason"),
    [
        (IMAGE, "left,camera,cam7", "no camera 'cam7'"),
        (IMAGE, "left,absent", "absent"),
        (IMAGE, "left,right", "right"),
        (IMAGE, "left,camera,cam0,cam1", "IMAGE,CAMERA"),
        (IMAGE, "small,camera", "for 128 x 96 pixels, the image has 64 x 48"),
        (PAIR, "left,right", "LEFT,RIGHT,CAMERA"),
        (PAIR, "left,right,camera,cam0", "LEFT,RIGHT,CAMERA"),
        (PAIR, "left,right,one", "only"),
        (PAIR, "left,right,backwards", "baseline_m"),
        (PAIR, "left,right,camera,cam0,cam0", "baseline"),
    ],
)
def test_inconsistent_input_is_refused_with_its_port(
    tmp_path: Path,
    images: tuple[Path, Path],
    monkeypatch: pytest.MonkeyPatch,
    port: Port,
    files: str,
    reason: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    kalibr(tmp_path / "camera")
    (tmp_path / "one").write_text("camera_matrix: [80, 0, 64, 0, 80, 48, 0, 0, 1]\n")
    (tmp_path / "backwards").write_text("camera_matrix: [80, 0, 64, 0, 80, 48, 0, 0, 1]\nbaseline_m: -0.1\n")
    (tmp_path / "small").write_bytes(write_png(np.zeros((48, 64), np.uint8)))
    with pytest.raises(InputError, match=reason) as refused:
        read_inputs([port], {port.name: files})
    assert str(refused.value).startswith(f"{port.name}=")


def test_an_image_name_may_contain_a_comma(tmp_path: Path) -> None:
    path = tmp_path / "a,b"
    path.write_bytes(write_png(np.zeros(SHAPE, np.uint8)))
    assert read_inputs([IMAGE], {"image": str(path)})["image"].image.shape == SHAPE


def test_a_depth_image_has_the_unit_of_its_camera_file(tmp_path: Path) -> None:
    raw = np.array([[0, 1500, 65535] * 12] * 36, np.uint16)
    cv2.imwrite(str(tmp_path / "depth.png"), raw)
    camera = {"px": 50.0, "py": 60.0, "u0": 17.0, "v0": 18.0, "w": 36, "h": 36}
    port = Port(name="depth", type="DistanceImage")
    (tmp_path / "camera.json").write_text(json.dumps(camera | {"depthScale": 0.001}), encoding="utf-8")
    files = f"{tmp_path / 'depth.png'},{tmp_path / 'camera.json'}"
    value = read_inputs([port], {"depth": files})["depth"]
    np.testing.assert_allclose(value.data[:3], [0.0, 1.5, 0.0])
    np.testing.assert_allclose([value.scale_x, value.center_y], [1.0 / 50.0, -18.0 / 60.0])
    (tmp_path / "camera.json").write_text(json.dumps(camera), encoding="utf-8")
    with pytest.raises(InputError, match="depthScale"):
        read_inputs([port], {"depth": files})

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff calibrate camera`` and ``stereo`` on folders of rendered images."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.camera import CameraModel, read_camera, read_stereo
from cdff_common.cli import main
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_core.calibration.boards import Board
from cdff_dev.calibrate.board_files import read_board
from cdff_dev.simulate.board_images import board_image, board_poses

BOARD, TEXT = Board("charuco", 7, 5, 0.04, 0.03), "charuco:7x5:0.04:0.03"
LEFT = CameraModel(240, 320, 260.0, 261.0, 158.0, 121.0, (-0.2, 0.05, 5e-4, -3e-4))
RIGHT = CameraModel(240, 320, 258.0, 259.0, 161.0, 118.0, (-0.19, 0.05, -4e-4, 2e-4))
T_RIGHT_LEFT = se3.transform(se3.exp_so3([0.01, -0.02, 0.005]), [-0.06, 0.001, 0.002])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the images of both cameras."""
    path, rng = tmp_path_factory.mktemp("boards"), np.random.default_rng(8)
    for name in ("left", "right"):
        (path / name).mkdir()
    for k, T in enumerate(board_poses(BOARD, 9, rng, distance_m=0.4, tilt_deg=30.0)):
        for name, camera, pose in (("left", LEFT, T), ("right", RIGHT, T_RIGHT_LEFT @ T)):
            cv2.imwrite(str(path / name / f"{k:03d}.png"), board_image(camera, BOARD, pose, rng, noise=1.0))
    return path


def test_a_camera_is_calibrated_from_a_folder(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["calibrate", "camera", str(folder / "left"), "--board", TEXT, "--coefficients", "4"]
    main([*command, "--out", str(tmp_path)])
    output = capsys.readouterr().out
    assert "assessment: " in output
    figures = json.loads((tmp_path / "calibration.json").read_text())
    fx = figures["cameras"][0]["parameters"]["fx"]
    assert abs(fx["value"] - 260.0) < 5.0 * fx["sigma"] < 10.0
    camera = read_camera(tmp_path / "calibration.yaml")
    assert (camera.fx, camera.rows, len(camera.distortion)) == (fx["value"], 240, 4)
    for name in ("coverage_0.png", "residuals_0.png"):
        assert cv2.imread(str(tmp_path / name)).shape == (240, 320, 3)


@pytest.mark.slow
def test_a_pair_is_calibrated_from_two_folders(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["calibrate", "stereo", str(folder), "--board", TEXT, "--coefficients", "4"]
    main([*command, "--out", str(tmp_path), "--json"])
    assert json.loads(capsys.readouterr().out)["views"] >= 15
    stereo = read_stereo(tmp_path / "calibration.yaml")
    assert stereo.baseline_m == pytest.approx(np.linalg.norm(T_RIGHT_LEFT[:3, 3]), abs=2e-4)


def test_a_board_that_is_not_there_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "camera", str(folder / "left"), "--board", "aprilgrid:6x6:0.03:0.3"]) == 1
    assert "detected in 0 images" in capsys.readouterr().err


def test_boards_are_read_from_texts_and_target_files_of_kalibr(tmp_path: Path) -> None:
    assert read_board(TEXT) == BOARD
    assert read_board("chessboard:9x6:0.03") == Board("chessboard", 9, 6, 0.03)
    assert read_board("charuco:7x5:0.04:0.03:DICT_6X6_250").dictionary == "DICT_6X6_250"
    path = tmp_path / "target.yaml"
    path.write_text("{target_type: aprilgrid, tagCols: 6, tagRows: 5, tagSize: 0.088, tagSpacing: 0.3}")
    assert read_board(str(path)) == Board("aprilgrid", 6, 5, 0.088, 0.3)
    assert read_board("tags:4x3:0.092:0.26") == Board("tags", 4, 3, 0.092, 0.26)
    path.write_text(
        "{target_type: checkerboard, targetCols: 6, targetRows: 7, "
        "colSpacingMeters: 0.06, rowSpacingMeters: 0.06}"
    )
    assert read_board(str(path)) == Board("chessboard", 6, 7, 0.06)


@pytest.mark.parametrize(
    "text", ["circles:4x5:0.1", "charuco:9:0.1:0.05", "chessboard:axb:0.1", "missing.yaml"]
)
def test_an_unknown_board_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="expected"):
        read_board(text)

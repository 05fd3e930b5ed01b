# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two sequences of a folder with a calibration of both cameras are stereo pairs."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.errors import InputError
from cdff_dev.logs import open_log
from tests.unit.cdff_dev.logs.formats.images.test_images import write_images

PAIR = "/robot/navcam.pair"
_MATRIX = (
    "!!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [60., 0., 32., 0., 60., 24., 0., 0., 1.]\n"
)
STEREO = (
    f"%YAML:1.0\n---\nM1: {_MATRIX}M2: {_MATRIX}D1: []\nD2: []\n"
    "R: [1., 0., 0., 0., 1., 0., 0., 0., 1.]\nT: [-0.2, 0., 0.]\n"
)


def stereo_folder(folder: Path, left: str, right: str) -> Path:
    write_images(folder, *(f"{left}{k}.png" for k in range(3)))
    write_images(folder, *(f"{right}{k}.png" for k in range(2)))
    (folder / "camera.yaml").write_text(STEREO, encoding="utf-8")
    return folder


def test_images_called_left_and_right_are_pairs(tmp_path: Path) -> None:
    log = open_log(stereo_folder(tmp_path, "left_", "right_"))
    assert list(log.streams) == [PAIR]
    samples = list(log.samples())
    assert [s.stamp_ns for s in samples] == [0, 100_000_000]
    assert samples[0].value.baseline == pytest.approx(0.2)
    assert [int(s.value.right.image[0, 0]) for s in samples] == [0, 1]
    assert log.unconverted["single images"].count == 1
    assert "camera.yaml" not in log.unconverted


def test_without_a_calibration_of_two_cameras_each_has_a_stream(tmp_path: Path) -> None:
    folder = stereo_folder(tmp_path, "left_", "right_")
    (folder / "camera.yaml").unlink()
    assert list(open_log(folder).streams) == ["/robot/left.frame", "/robot/right.frame"]


def test_sub_folders_are_pairs_with_the_named_calibration(tmp_path: Path) -> None:
    calibration = tmp_path / "mine.yaml"
    calibration.write_text(STEREO, encoding="utf-8")
    for side in ("left", "right"):
        write_images(tmp_path / "drive" / side, "000.png", "001.png")
    assert open_log(tmp_path / "drive", calibration).streams[PAIR].count == 2
    calibration.write_text(STEREO.replace("32.", "320."), encoding="utf-8")
    with pytest.raises(InputError, match=r"mine\.yaml"):
        open_log(tmp_path / "drive", calibration)

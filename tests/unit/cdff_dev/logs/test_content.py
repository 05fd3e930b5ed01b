# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files and folders that are no recordings are described in one line; recordings open by their path alone."""

from __future__ import annotations

import gzip
import json
import struct
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.errors import InputError
from cdff_dev.logs import open_log

#: Data sets of which every file and folder opens.
SETS = [
    "kitti_stereo",
    "kitti_velodyne",
    "rosbags",
    "pocolog",
    "infuse_logs",
    "euroc_v101_pairs",
    "seven_scenes_redkitchen",
    "speedplus_lightbox",
    "rosetta_67p",
    "star_images",
    "visp_castle",
    "visp_rbt_rgbd",
    "bop_tyol_frame",
    "m3t_pair",
]


@pytest.mark.parametrize(
    ("name", "data", "content"),
    [
        ("a.g2o", b"VERTEX_SE2 0 0 0 0\n", "pose graph (for cdff run pose_graph_optimization graph=FILE)"),
        ("a.obj", b"v 0 0 0\n", "model of an object (for cdff run model_detection model=FILE)"),
        ("a.csv", b"x_m,y_m\n1,2\n", "table with x_m, y_m"),
        ("a.csv.gz", gzip.compress(b"x_m,y_m\n1,2\n", mtime=0), "compressed table with x_m, y_m"),
        ("a.json", b'{"RA": 1, "Dec": 2}', "JSON with the names RA, Dec"),
        ("a.yaml", b"edges: 5\n", "YAML settings"),
        (
            "camera.json",
            b'{"cameraMatrix": [[9, 0, 4], [0, 9, 4], [0, 0, 1]], "distCoeffs": [0, 0, 0, 0]}',
            "calibration of a camera (for its folder of images, or --calibration FILE)",
        ),
        ("T.txt", b"1 0 0 1\n0 1 0 2\n0 0 1 3\n0 0 0 1\n", "pose as a matrix (for cdff run NAME guess=FILE)"),
        (
            "problem.bin",
            b"vP" + bytes(32) + struct.pack("<iii", 0, 0, 0),
            "bundle adjustment problem (for cdff run bundle_adjustment problem=FILE)",
        ),
        ("README.txt", b"SET: clouds\n", "text"),
        ("run.bag", b"", "empty file of 0 bytes: its recording or copy did not start"),
    ],
)
def test_a_file_that_is_no_recording_is_described(
    tmp_path: Path, name: str, data: bytes, content: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(data)
    assert main(["log", "info", str(tmp_path / name)]) == 0
    assert capsys.readouterr().out == f"no recording: {content}\n"
    assert main(["log", "info", "--json", str(tmp_path / name)]) == 0
    assert json.loads(capsys.readouterr().out) == {"streams": {}, "content": content}
    with pytest.raises(
        InputError, match="none of the known formats" if content == "text" else "no recording"
    ):
        open_log(tmp_path / name)


def test_a_folder_that_is_no_recording_is_described_by_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a.obj", "b.obj", "README.txt"):
        (tmp_path / name).write_text("v 0 0 0\n")
    assert main(["log", "info", str(tmp_path)]) == 0
    assert capsys.readouterr().out == (
        "no recording: 2 x model of an object (for cdff run model_detection model=FILE); 1 x text\n"
    )


def test_an_unknown_file_is_refused_with_the_known_formats(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.dat").write_bytes(bytes(range(256)))
    assert main(["log", "info", str(tmp_path / "a.dat")]) == 1
    assert "none of the known formats" in capsys.readouterr().err


def test_an_image_and_a_pattern_of_images_are_recordings(tmp_path: Path) -> None:
    for number in (1, 2, 3):
        cv2.imwrite(str(tmp_path / f"img{number}.png"), np.full((4, 6), number, np.uint8))
    with open_log(tmp_path / "img2.png") as log:
        (sample,) = log.samples()
    assert (sample.stream, sample.stamp_ns) == ("/robot/camera.frame", 200_000_000)
    assert sample.value.image[0, 0] == 2
    with open_log(tmp_path / "img[12].png") as log:
        assert [s.value.image[0, 0] for s in log.samples()] == [1, 2]


@pytest.mark.slow
@pytest.mark.parametrize("name", SETS)
def test_every_file_and_folder_of_a_data_set_opens_by_its_path_alone(
    real_data: Callable[[str], Path], name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = real_data(name)
    kinds = {(p.parent, p.suffix): p for p in sorted(folder.rglob("*")) if p.is_file()}
    paths = [folder, *(p for p in folder.rglob("*") if p.is_dir()), *kinds.values()]
    refused = [str(path.relative_to(folder)) for path in paths if main(["log", "info", str(path)]) != 0]
    assert not refused, capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "head", "expected"),
    [
        ("drive.mp4", b"\0\0\0\x18ftypmp42", "MP4 or MOV video, not supported: extract images"),
        ("flight.ulg", b"ULog\x01\x12\x35\x01", "PX4 log, not supported"),
        ("data.h5", b"\x89HDF\r\n\x1a\n", "HDF5 file, not supported"),
        ("scans.zip", b"PK\x03\x04", "zip archive, not supported: unpack it"),
    ],
)
def test_files_of_other_formats_are_named_with_a_remedy(
    name: str, head: bytes, expected: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(head + bytes(300))
    with pytest.raises(InputError, match="no recording") as refused:
        open_log(tmp_path / name)
    assert expected in str(refused.value)

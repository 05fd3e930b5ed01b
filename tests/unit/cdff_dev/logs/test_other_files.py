# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files next to a recording that its reader does not use are listed."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_dev.logs import open_log
from cdff_dev.logs.other_files import other_files
from evaluation.scenes import data_set_files, ouster_captures
from evaluation.scenes.data_set_files import Files

#: A recording of each layout of a folder.
LAYOUTS: dict[str, Files] = {
    "KITTI odometry": data_set_files.kitti(),
    "KITTI raw": data_set_files.kitti_raw(),
    "EuRoC": data_set_files.euroc(),
    "EuRoC pairs": data_set_files.euroc_pairs(),
    "TUM RGB-D": data_set_files.tum(),
    "image folder": data_set_files.images(),
    "7-Scenes": data_set_files.seven_scenes(),
    "7-Scenes extract": data_set_files.seven_scenes_extract(),
    "BOP scene": data_set_files.bop_scene(),
    "BOP frame": data_set_files.bop_frame(),
    "SPEED": data_set_files.speed(),
    "Ouster": ouster_captures.recording("LEGACY"),
}


def test_a_few_files_of_a_type_are_named_and_many_are_counted(tmp_path: Path) -> None:
    for name in ("0.bin", "README.txt", "map.g2o", *(f"{k}.dat" for k in range(5))):
        (tmp_path / name).write_bytes(b"\x00\x01")
    unread_files = other_files(tmp_path, lambda file: file.suffix == ".bin", "no scan")
    assert {name: (item.count, item.reason) for name, item in unread_files.items()} == {
        "*.dat": (5, "no scan"),
        "map.g2o": (1, "pose graph (for cdff run pose_graph_optimization graph=FILE)"),
    }


def test_a_folder_of_scans_lists_its_other_files(tmp_path: Path) -> None:
    for k in range(2):
        (tmp_path / f"{k}.xyz").write_text("1 2 3\n4 5 6\n7 8 9\n", encoding="utf-8")
    (tmp_path / "times.txt").write_text("0.0\n0.1\n", encoding="utf-8")
    (tmp_path / "poses.kml").write_text("<kml/>", encoding="utf-8")
    log = open_log(tmp_path)
    assert log.streams["/robot/lidar.scan"].count == 2
    assert list(log.unconverted) == ["poses.kml"]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_no_file_of_a_folder_is_dropped_in_silence(tmp_path: Path, layout: str) -> None:
    for name, content in LAYOUTS[layout].items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    with open_log(tmp_path) as log:
        assert not [name for name, item in log.unconverted.items() if item.type_name == "file"]
    folders = [tmp_path, *(path for path in tmp_path.rglob("*") if path.is_dir())]
    for folder in folders:
        (folder / "unknown.dat").write_bytes(b"\x00\x01")
    with open_log(tmp_path) as log:
        files = {name: item for name, item in log.unconverted.items() if item.type_name == "file"}
    assert sum(item.count for item in files.values()) == len(folders)
    assert all(item.reason for item in files.values())


def test_a_file_that_is_a_recording_of_its_own_is_named(tmp_path: Path) -> None:
    for k in range(2):
        (tmp_path / f"{k}.xyz").write_text("1 2 3\n4 5 6\n7 8 9\n", encoding="utf-8")
    (tmp_path / "poses.txt").write_text("1 0 0 2 0 1 0 3 0 0 1 4\n" * 2, encoding="utf-8")
    assert open_log(tmp_path).unconverted["poses.txt"].reason == "poses: open it alone"

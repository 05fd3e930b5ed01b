# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files next to a recording that its reader does not use are listed."""

from __future__ import annotations

from pathlib import Path

from cdff_dev.logs import open_log
from cdff_dev.logs.other_files import other_files


def test_a_few_files_of_a_type_are_named_and_many_are_counted(tmp_path: Path) -> None:
    for name in ("0.bin", "README.txt", "map.g2o", *(f"{k}.dat" for k in range(5))):
        (tmp_path / name).write_bytes(b"\x00\x01")
    found = other_files(tmp_path, lambda file: file.suffix == ".bin", "no scan")
    assert {name: (item.count, item.reason) for name, item in found.items()} == {
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

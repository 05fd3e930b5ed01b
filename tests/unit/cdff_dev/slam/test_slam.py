# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff slam`` and ``cdff vo`` go from a path to trajectory, map and pictures."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cdff_common.cli import EXIT_ERROR, EXIT_REFUSED, main
from cdff_common.formats.ply import read_ply
from cdff_common.formats.tum import read_tum

PNG = b"\x89PNG"
PAIRS = 8


@pytest.fixture
def drive(real_data: Callable[[str], Path], tmp_path: Path) -> Path:
    """The first pairs of a KITTI sequence with calibration and true poses."""
    source, folder = real_data("kitti_stereo/KITTI_sequence_1"), tmp_path / "drive"
    for side in ("image_l_kitti", "image_r_kitti"):
        (folder / side).mkdir(parents=True)
        for image in sorted((source / side).iterdir())[:PAIRS]:
            shutil.copy(image, folder / side)
    for name in ("calib.txt", "calib_kitti.txt", "poses.txt"):
        if (source / name).is_file():
            shutil.copy(source / name, folder)
    return folder


def test_vo_writes_trajectory_picture_and_errors(drive: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["vo", str(drive), "--out", str(out)]) == 0
    stamps_ns, T = read_tum(out / "trajectory.tum")
    assert len(stamps_ns) == PAIRS
    np.testing.assert_allclose(T[0], np.eye(4), atol=1e-9)
    rows = np.loadtxt(out / "trajectory_kitti.txt").reshape(-1, 3, 4)
    np.testing.assert_allclose(rows, T[:, :3], atol=1e-6)
    assert (out / "trajectory.png").read_bytes().startswith(PNG)
    run = json.loads((out / "run.json").read_text(encoding="utf-8"))
    assert run["statuses"] == {"OK": PAIRS}
    assert run["truth"]["ate"]["translation_m"]["rmse"] < 0.01 * run["path_length_m"]
    assert not (out / "map.ply").exists()


def test_slam_writes_map_graph_and_pictures(
    real_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scans, out = tmp_path / "scans", tmp_path / "out"
    scans.mkdir()
    for n in range(2):
        shutil.copy(real_data(f"kitti_velodyne/{n:06d}.bin"), scans)
    assert main(["slam", str(scans), "--out", str(out)]) == 0
    assert "no comparison: the log has no stream of true poses" in capsys.readouterr().out
    assert len(read_ply(out / "map.ply").points_m) > 1000
    assert (out / "map.png").read_bytes().startswith(PNG)
    assert "VERTEX_SE" in (out / "graph.g2o").read_text(encoding="utf-8")
    # The car moves forward by about 0.9 m between these sweeps.
    _, T = read_tum(out / "trajectory.tum")
    assert 0.5 < np.linalg.norm(T[-1, :3, 3]) < 1.5


@pytest.mark.slow
def test_pairs_too_far_apart_are_refused_with_the_reason(
    real_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(real_data("euroc_v101_pairs/query"))
    assert main(["vo", folder, "--out", str(tmp_path / "out")]) == EXIT_REFUSED
    message = capsys.readouterr().err
    assert "pairs were not located" in message
    assert "7.97 s apart" in message
    assert not (tmp_path / "out").exists()


def test_a_log_without_the_sensor_is_refused_with_what_it_has(
    drive: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["slam", str(drive)]) == EXIT_ERROR
    message = capsys.readouterr().err
    assert "/kitti/navcam.pair (FramePair)" in message
    assert "use cdff vo" in message

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff replay`` and ``cdff run`` with compounds for known objects on shared folders of images."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.cli import main

pytestmark = [pytest.mark.slow]
RealData = Callable[[str], Path]
Captured = pytest.CaptureFixture[str]


def cdff(capsys: Captured, *arguments: object) -> tuple[int, str, str]:
    """Return the exit code and the texts on standard output and standard error."""
    code = main(list(map(str, arguments)))
    captured = capsys.readouterr()
    return code, captured.out, captured.err


def test_a_castle_is_tracked_in_a_folder_of_images_from_a_guess(
    real_data: RealData, tmp_path: Path, capsys: Captured
) -> None:
    folder = real_data("visp_castle")
    with (folder / "truth.csv").open() as file:
        rows = [
            np.array([[float(row[f"T{i}{j}"]) for j in range(4)] for i in range(3)])
            for row in csv.DictReader(file)
        ]
    np.savetxt(tmp_path / "guess.txt", np.vstack([rows[0], [0.0, 0.0, 0.0, 1.0]]))
    code, out, error = cdff(
        capsys,
        *("replay", folder, "--dfpc", "visual_target_tracking", "--map", "image=/robot/gray.frame"),
        *("--model", folder / "models" / "chateau.wrl", "--guess", tmp_path / "guess.txt"),
        *("--duration", 1, "--out", tmp_path / "out", "--json"),
    )
    assert code == 0, error
    report: dict[str, Any] = json.loads(out)
    assert report["samples_by_port"] == {"guess": 1, "image": 11, "model": 1}
    assert report["failed"] == 0
    poses = np.loadtxt(tmp_path / "out" / "pose.tum")
    true_m = np.array([T[:, 3] for T in rows[: len(poses)]])
    assert np.linalg.norm(poses[:, 1:4] - true_m, axis=1).max() < 0.004


def test_a_photograph_of_a_satellite_without_an_answer_exits_with_the_reason(
    real_data: RealData, tmp_path: Path, capsys: Captured
) -> None:
    folder = real_data("speedplus_lightbox")
    image = f"{folder / 'images' / 'img000001.jpg'},{folder / 'camera.json'}"
    code, out, error = cdff(
        capsys,
        *("run", "target_detection", f"model={folder / 'tango.ply'}", f"image={image}"),
        *("--out", tmp_path / "out"),
    )
    assert code == 3, error
    assert "bright_background" in out + error


def test_the_unit_of_a_model_in_millimetres_is_missed_or_stated(
    real_data: RealData, tmp_path: Path, capsys: Captured
) -> None:
    folder = real_data("bop_tyol_frame")
    arguments = ("replay", folder, "--dfpc", "model_detection", "--model", folder / "obj.ply")
    assert "wrong_unit" in cdff(capsys, *arguments, "--out", tmp_path / "metres")[2]
    (tmp_path / "unit.yaml").write_text("unit: mm\n")
    error = cdff(capsys, *arguments, "--config", tmp_path / "unit.yaml", "--out", tmp_path / "mm")[2]
    assert "wrong_unit" not in error
    assert "low_score" in error

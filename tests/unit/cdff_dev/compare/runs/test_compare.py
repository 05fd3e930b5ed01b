# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Two runs are compared by the files in their folders."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.cli import main
from cdff_common.formats.cloud import CloudArrays
from cdff_common.formats.ply import write_ply
from cdff_common.formats.tum import write_tum
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap
from cdff_dev.compare.runs import compare_runs, table

STAMPS_NS = np.arange(20, dtype=np.int64) * 100_000_000


def run(folder: Path, offset_m: float, **summary: Any) -> Path:
    folder.mkdir()
    T = np.tile(np.eye(4), (20, 1, 1))
    T[:, 0, 3] = np.arange(20) * 0.5
    T[:, 1, 3] = offset_m
    (folder / "trajectory.tum").write_bytes(write_tum(STAMPS_NS, T))
    heights = np.full((10, 10), offset_m, np.float32) + np.arange(10, dtype=np.float32)
    geometry = GridGeometry("site", 0.5, 0.0, 5.0, 10, 10)
    ElevationMap.from_layers(geometry, {"mean": heights}, t0_ns=0, t1_ns=0).save(folder / "dem.tif")
    answers = [
        {"request": "r1", "answer": "product", "delivered": {"differences": []}, "after_s": 0.5},
        {"request": "r2", "answer": "error", "code": "DEADLINE", "after_s": 2.0 + offset_m},
    ]
    if offset_m:
        answers[0] = {"request": "r1", "answer": "error", "code": "UNAVAILABLE", "after_s": 1.5}
    (folder / "answers.json").write_text(json.dumps(answers))
    document = {"cdff": "0.1.0", "cpu_s": 1.0 + offset_m, "parameters": {"voxel_m": 0.5}, **summary}
    (folder / "run.json").write_text(json.dumps(document))
    return folder


def test_differences_of_all_parts_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    a = run(tmp_path / "a", 0.2, parameters={"voxel_m": 0.4}, statuses={"OK": 19, "FAILED": 1})
    b = run(tmp_path / "b", 0.0, statuses={"OK": 20})
    (a / "map.ply").write_bytes(b"ply")
    results = compare_runs(a, b)
    assert results["configuration"] == {"parameters.voxel_m": [0.4, 0.5]}
    assert results["quality"] == {"statuses.FAILED": [1, None], "statuses.OK": [19, 20]}
    assert results["cost"]["cpu_s"] == [1.2, 1.0]
    assert results["trajectories"]["trajectory.tum"]["rmse_m"] == pytest.approx(0.2)
    assert results["maps"]["dem.tif"]["bias_m"] == pytest.approx(0.2, abs=1e-5)
    assert results["requests"]["different"] == {"r1": ["error UNAVAILABLE", "product"]}
    assert results["only_in_a"] == ["map.ply"]
    assert main(["eval", "compare", str(a), str(b)]) == 0
    assert "parameters.voxel_m  0.4  0.5" in capsys.readouterr().out


def test_clouds_of_both_runs_are_compared_by_the_distances_of_their_points(tmp_path: Path) -> None:
    a, b = run(tmp_path / "a", 0.0), run(tmp_path / "b", 0.0)
    points_m = np.column_stack([np.arange(100.0), np.zeros((100, 2))])
    (a / "map.ply").write_bytes(write_ply(CloudArrays.of(points_m[:50] + np.array([0.0, 0.3, 0.0]))))
    (b / "map.ply").write_bytes(write_ply(CloudArrays.of(points_m)))
    compared = compare_runs(a, b)["maps"]["map.ply"]
    assert compared["points"] == [50, 100]
    assert [compared[name] for name in ("median_m", "p95_m", "max_m")] == pytest.approx([0.3] * 3, abs=1e-6)
    (b / "map.ply").write_bytes(b"ply")
    assert "map.ply" in compare_runs(a, b)["maps"]["map.ply"]["error"]


def test_the_configuration_of_a_second_dfpc_is_no_quality(tmp_path: Path) -> None:
    a, b = (
        run(tmp_path / name, 0.0, dem={"parameters": {"cell_m": x}, "patches": 2}) for name, x in ("a1", "b2")
    )
    results = compare_runs(a, b)
    assert results["configuration"] == {"dem.parameters.cell_m": ["1", "2"]}
    assert results["quality"] == {}


def test_equal_runs_have_no_differences(tmp_path: Path) -> None:
    results = compare_runs(run(tmp_path / "a", 0.0), run(tmp_path / "b", 0.0))
    assert not results["configuration"]
    assert not results["quality"]
    assert "configuration: no difference" in table(results)


def test_a_folder_without_a_run_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["eval", "compare", str(tmp_path), str(tmp_path)]) == 1
    assert "no run: expected a folder with run.json" in capsys.readouterr().err

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cdff_common.cli import main
from cdff_common.errors import InputError
from cdff_common.interfaces.registry import Registry
from cdff_dev.campaign.sweep import units_of
from tests.support.dask_cluster import DaskCluster


def arguments(**given: Any) -> argparse.Namespace:
    names = ("robot", "implementation", "start", "duration", "seed", "until", "profile", "guess", "poses")
    defaults: dict[str, Any] = dict.fromkeys((*names, "calibration"))
    return argparse.Namespace(
        **{**defaults, "map": [], "mask": [], "model": [], "log": "log.tum", "dfpc": "tracking_3d", **given}
    )


def test_a_sweep_has_a_unit_for_each_combination_with_its_configuration(tmp_path: Path) -> None:
    values = {"seed": [1, 2], "icp.iterations": [10, 30]}
    units = list(units_of(arguments(robot="mana"), values, {"icp": {"voxel_m": 0.1}}, tmp_path))
    assert [unit.labels for unit in units] == [
        {"seed": seed, "icp.iterations": iterations} for seed in (1, 2) for iterations in (10, 30)
    ]
    third = units[2].arguments
    assert third[third.index("--seed") + 1] == "2"
    assert third[third.index("--robot") + 1] == "mana"
    configuration = yaml.safe_load(Path(third[third.index("--config") + 1]).read_text())
    assert configuration == {"icp": {"voxel_m": 0.1, "iterations": 10}}


def test_a_folder_takes_the_results_of_one_sweep(tmp_path: Path) -> None:
    list(units_of(arguments(), {"seed": [1, 2]}, {}, tmp_path))
    list(units_of(arguments(), {"seed": [1, 2, 3]}, {}, tmp_path))
    with pytest.raises(InputError, match="another sweep"):
        list(units_of(arguments(), {"seed": [4]}, {}, tmp_path))


@pytest.mark.parametrize("values", [{"seed": 1}, {"seed": []}, {"seed": list(range(10_001))}])
def test_a_sweep_without_lists_or_too_large_is_refused(tmp_path: Path, values: dict[str, Any]) -> None:
    with pytest.raises(InputError, match="sweep"):
        list(units_of(arguments(), values, {}, tmp_path))


def test_a_missing_library_for_the_table_is_reported_before_the_first_replay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    (tmp_path / "sweep.yaml").write_text("seed: [1, 2]\n")
    command = ["replay", "poses.tum", "--dfpc", "tracking_3d", "--sweep", str(tmp_path / "sweep.yaml")]
    assert main([*command, "--out", str(tmp_path / "out")]) == 1
    assert "pip install 'cdff[parquet]'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_example_of_the_page_has_parameters_of_its_dfpc(tmp_path: Path) -> None:
    page = (Path(__file__).parents[4] / "docs" / "how-to" / "run-a-campaign.md").read_text()
    example = yaml.safe_load(page.split("```yaml\n")[1].split("```")[0])
    for unit in units_of(arguments(dfpc="lidar_slam"), example, {}, tmp_path):
        configuration = yaml.safe_load(Path(unit.arguments[unit.arguments.index("--config") + 1]).read_text())
        Registry.default().make_dfpc("lidar_slam").configure(configuration)


def write_poses(path: Path) -> None:
    """Write the poses of a rotating body."""
    noise = np.random.default_rng(5).normal(0.0, 0.002, (40, 6))
    angles = 0.05 * np.arange(40)
    lines = [
        f"{0.5 * i} {0.1 * i + e[0]} {e[1]} {e[2]} {e[3]} {e[4]} {np.sin(a / 2)} {np.cos(a / 2)}"
        for i, (a, e) in enumerate(zip(angles, noise, strict=True))
    ]
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.slow
def test_the_command_replays_a_log_with_each_value_on_this_machine_and_on_dask(
    cluster: DaskCluster, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    write_poses(tmp_path / "poses.tum")
    (tmp_path / "sweep.yaml").write_text("seed: [1, 2]\n")
    here, there = tmp_path / "here", tmp_path / "there"
    command = ["replay", str(tmp_path / "poses.tum"), "--dfpc", "tracking_3d"]
    command += ["--sweep", str(tmp_path / "sweep.yaml")]
    assert main([*command, "--out", str(here)]) == 0
    assert main([*command, "--out", str(there), "--dask", cluster.address]) == 0
    for out in (here, there):
        rows = parquet.read_table(out / "results.parquet").to_pylist()
        assert [(row["name"], row["label_seed"], row["exit_code"]) for row in rows] == [
            ("replay_0000", "1", 0),
            ("replay_0001", "2", 0),
        ]
        assert json.loads(rows[0]["summary"])["samples"] == 40
    for name in ("replay_0000", "replay_0001"):
        outputs = [(out / name / "outputs.msg").read_bytes() for out in (here, there)]
        assert outputs[0] == outputs[1]
    capsys.readouterr()
    assert main([*command, "--out", str(there), "--dask", cluster.address]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert sorted(line.partition(":")[0] for line in printed) == [
        "replay_0000",
        "replay_0001",
        f"wrote {there / 'results.parquet'}",
    ]


@pytest.mark.slow
def test_a_failed_replay_of_a_sweep_is_named_and_the_others_continue(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    write_poses(tmp_path / "poses.tum")
    (tmp_path / "sweep.yaml").write_text("implementation: [none, batch]\n")
    command = ["replay", str(tmp_path / "poses.tum"), "--dfpc", "tracking_3d", "--out", str(tmp_path / "out")]
    assert main([*command, "--sweep", str(tmp_path / "sweep.yaml")]) == 3
    assert "replays failed, the first is replay_0000" in capsys.readouterr().err
    rows = parquet.read_table(tmp_path / "out" / "results.parquet").to_pylist()
    assert rows[0]["exit_code"] == 1
    assert "none" in rows[0]["error"]

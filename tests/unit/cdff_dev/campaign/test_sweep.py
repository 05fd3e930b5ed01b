# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cdff_common.cli import main
from cdff_common.errors import InputError
from cdff_dev.campaign.sweep import units_of


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


@pytest.mark.slow
def test_the_command_replays_a_log_with_each_value(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed")
    noise = np.random.default_rng(5).normal(0.0, 0.002, (40, 6))
    angles = 0.05 * np.arange(40)
    lines = [
        f"{0.5 * i} {0.1 * i + e[0]} {e[1]} {e[2]} {e[3]} {e[4]} {np.sin(a / 2)} {np.cos(a / 2)}"
        for i, (a, e) in enumerate(zip(angles, noise, strict=True))
    ]
    (tmp_path / "poses.tum").write_text("\n".join(lines) + "\n")
    (tmp_path / "sweep.yaml").write_text("seed: [1, 2]\n")
    out = tmp_path / "out"
    command = ["replay", str(tmp_path / "poses.tum"), "--dfpc", "tracking_3d", "--out", str(out)]
    assert main([*command, "--sweep", str(tmp_path / "sweep.yaml")]) == 0
    rows = parquet.read_table(out / "results.parquet").to_pylist()
    assert [(row["name"], row["label_seed"], row["exit_code"]) for row in rows] == [
        ("replay_0000", "1", 0),
        ("replay_0001", "2", 0),
    ]
    assert json.loads(rows[0]["summary"])["samples"] == 40
    assert (out / "replay_0001" / "outputs.msg").is_file()

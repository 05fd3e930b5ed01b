# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff mission``: a rover leaves its base, drives with guidance on its own maps, and returns."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from cdff_dev.ports import free_port

pytestmark = [pytest.mark.e2e, pytest.mark.slow, pytest.mark.timeout(400)]

MISSION = {
    "doc": "A short drive out and back.",
    "profile": "explorer",
    "scenario": "outing",
    "speed": 4,
    "robots": {
        "mana": [{"do": "straight", "length_m": 5.0}, {"do": "go_to", "xy_m": [16.0, 5.0]}, {"do": "return"}]
    },
    "requests": [
        {
            "at_s": 12,
            "type": "dem",
            "robot": "mana",
            "frame": "site",
            "region": "near:mana/base,5",
            "resolution_m": 0.2,
            "max_age_s": 60,
            "min_coverage": 0.6,
            "deadline_ms": 60000,
        },
    ],
    "limits": {"goal_m": 0.8, "min_path_length_m": 25.0},
}


def test_a_rover_drives_out_and_back_on_its_own_maps_and_is_scored(tmp_path: Path) -> None:
    mission, report = tmp_path / "short.yaml", tmp_path / "short.html"
    mission.write_text(yaml.safe_dump(MISSION), encoding="utf-8")
    command = [
        sys.executable,
        "-m",
        "cdff_common.cli",
        "mission",
        str(mission),
        "--json",
        "--report",
        str(report),
        "--connect",
        f"tcp/127.0.0.1:{free_port()}",
        "--http",
        f"127.0.0.1:{free_port()}",
        "--data-dir",
        str(tmp_path / "data"),
    ]
    result = subprocess.run(command, capture_output=True, text=True, timeout=380, check=False)
    assert result.stdout, result.stderr
    output = json.loads(result.stdout)
    assert output["faults"] == []
    assert result.returncode == 0
    score = output["score"]
    assert [goal["goal"] for goal in score["reached"]] == ["(16, 5)", "where it began"]
    assert 25.0 < score["located"][0]["path_length_m"] < 60.0
    assert 0.0 < score["located"][0]["largest_m"] < 0.3
    assert score["mapped"]["cells"] > 2000
    assert abs(score["mapped"]["bias_m"]) < 0.05
    assert score["driven"][0]["places"] > 100
    page = report.read_text(encoding="utf-8")
    assert "All limits of the mission are met." in page
    assert "<polyline" in page
    assert "navigation_map" in page


def test_an_unknown_mission_is_refused_with_the_names_of_the_shipped_ones() -> None:
    command = [sys.executable, "-m", "cdff_common.cli", "mission", "to_the_moon"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 1
    assert "long_traverse_navigation" in result.stderr
    assert "return_to_base" in result.stderr

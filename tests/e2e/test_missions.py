# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A mission as a user runs it: a rover leaves its base, is guided over its own maps, and comes back."""

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
    "doc": "A short way out and back.",
    "profile": "explorer",
    "scenario": "outing",
    "speed": 4,
    "robots": {"mana": [{"do": "straight", "length_m": 5.0}, {"do": "go_to", "xy_m": [16.0, 5.0]}, {"do": "return"}]},
    "requests": [
        {"at_s": 12, "type": "dem", "robot": "mana", "frame": "site", "region": "near:mana/base,5", "resolution_m": 0.2,
         "max_age_s": 60, "min_coverage": 0.6, "deadline_ms": 60000},
    ],
    "judged": {"goal_m": 0.8, "least_way_m": 25.0},
}  # fmt: skip


def test_a_rover_is_guided_out_and_back_on_the_maps_it_makes_and_the_score_says_so(tmp_path: Path) -> None:
    mission, report = tmp_path / "short.yaml", tmp_path / "short.html"
    mission.write_text(yaml.safe_dump(MISSION), encoding="utf-8")
    command = [
        sys.executable, "-m", "cdff_common.cli", "mission", str(mission), "--json", "--report", str(report),
        "--connect", f"tcp/127.0.0.1:{free_port()}", "--http", f"127.0.0.1:{free_port()}",
        "--data-dir", str(tmp_path / "data"),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=380, check=False)
    assert done.stdout, done.stderr
    said = json.loads(done.stdout)
    assert said["faults"] == []
    assert done.returncode == 0
    score = said["score"]
    assert [goal["goal"] for goal in score["reached"]] == ["(16, 5)", "where it began"]
    assert 25.0 < score["located"][0]["way_m"] < 60.0
    assert 0.0 < score["located"][0]["largest_m"] < 0.3
    assert score["mapped"]["cells"] > 2000
    assert abs(score["mapped"]["bias_m"]) < 0.05
    assert score["driven"][0]["places"] > 100
    page = report.read_text(encoding="utf-8")
    assert "All that the mission demands holds." in page
    assert "<polyline" in page
    assert "navigation_map" in page


def test_a_mission_that_is_not_there_is_refused_with_the_names_of_those_that_are() -> None:
    command = [sys.executable, "-m", "cdff_common.cli", "mission", "to_the_moon"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert "long_traverse_navigation" in done.stderr
    assert "return_to_base" in done.stderr

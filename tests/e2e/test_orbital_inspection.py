# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The end of the mission orbital_inspection with processes: guided by poses, a model is delivered."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from cdff_dev.ports import free_port

pytestmark = [pytest.mark.e2e, pytest.mark.soak, pytest.mark.timeout(600)]

SCENARIO = """
extends: orbit_inspection
name: orbit_inspection_short
seed: 20261131
held_out_seeds: []
servicer: {start_m: [-24.0, 0.0, 1.0]}
"""
MISSION = """
kind: orbit
doc: The servicer approaches from 24 m, moves around the client and delivers its surface.
profile: orbital_inspection
scenario: %s
speed: 4
models: {client: satellite}
tracker: lidar_target_tracking
tasks:
  - {do: wait, duration_s: 11}
  - do: approach
    by: pose
    frame: servicer/lidar
    distance_m: 14
    speed_m_s: 0.8
    max_sigma_m: 0.3
    max_sigma_deg: 10
  - {do: fly_around, frame: servicer/lidar, distance_m: 14, angle_deg: 15, steps: 1, step_s: 20}
  - {do: ask, request: {type: mesh, robot: servicer, frame: client/body, max_age_s: 30, deadline_ms: 60000}}
  - do: cut_link
    duration_s: 2
    request: {type: track, robot: servicer, frame: servicer/lidar, max_age_s: 10, deadline_ms: 3000}
  - do: ask
    request: {type: track, robot: servicer, frame: servicer/lidar, max_age_s: 20, deadline_ms: 60000}
limits: {min_poses: 5, position_m: 0.03, rotation_deg: 1.0, within_three_sigma: 0.7, model_rms_m: 0.06}
"""


def test_a_servicer_guided_by_its_own_tracks_delivers_a_model(tmp_path: Path) -> None:
    scenario, mission, report = (tmp_path / name for name in ("scenario.yaml", "mission.yaml", "report.html"))
    scenario.write_text(SCENARIO, encoding="utf-8")
    mission.write_text(MISSION % scenario, encoding="utf-8")
    addresses = ["--connect", f"tcp/127.0.0.1:{free_port()}", "--http", f"127.0.0.1:{free_port()}"]
    command = [
        "-m",
        "cdff_common.cli",
        "mission",
        str(mission),
        "--json",
        "--report",
        str(report),
        *addresses,
    ]
    completed = subprocess.run([sys.executable, *command], capture_output=True, text=True, check=False)
    assert completed.stdout.strip(), completed.stderr
    result = json.loads(completed.stdout.splitlines()[-1])
    assert result["faults"] == []
    assert completed.returncode == 0
    assert result["displacements"] >= 2
    assert result["poses"]["distance_m"][0] < 16.0
    assert result["requests"]["failed"] == 0
    assert result["requests"]["refused_with_reason"] >= 1  # the request during the outage
    assert result["model"]["median_m"] < 0.03
    page = report.read_text(encoding="utf-8")
    assert "All limits of the mission are met." in page
    assert "link interrupted" in page
    assert page.count("data:image/png") >= 4  # three views of the model, and images

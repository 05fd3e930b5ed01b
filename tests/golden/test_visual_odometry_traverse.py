# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Visual odometry on a part of the simulated traverse visual_rocks: the first metres of one rover."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.store import simulated_log
from evaluation.runs.traverse import traverse_runs
from evaluation.runs.visual_traverses import score_drive

pytestmark = [pytest.mark.golden, pytest.mark.slow, pytest.mark.timeout(900)]
SLICE = """
extends: visual_rocks
name: visual_rocks_slice
duration_s: 8.0
robots:
  r2:
    start_xy_m: [-9.6, 3.0]
    heading_deg: -6.0
    curvature_1pm: [[0.0, 0.0], [2.0, -0.12], [5.0, 0.12], [9.0, 0.0]]
    speed_m_s: 0.40
    rest_before_s: 1.0
    rest_after_s: 0.5
    ramp_s: 1.0
"""


@pytest.mark.req("CDFF-CORE-070")
def test_a_part_of_the_rocky_traverse_has_an_end_error_below_one_percent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    scenario = tmp_path / "visual_rocks_slice.yaml"
    scenario.write_text(SLICE, encoding="utf-8")
    # Without workers, because for a dozen pairs their start would take longer than the simulation.
    simulated_log(load_scenario(str(scenario)), workers=0)
    (drive,) = traverse_runs(str(scenario))[1]
    row = score_drive(drive)
    drive.log.close()
    assert row["path_length_m"] > 1.5
    assert row["end_percent"] < 1.0
    assert (row["failed"], row["degraded"]) == (0.0, 0.0)
    assert row["nees"] < 22.5  # 99.9 % quantile of χ² with six degrees of freedom

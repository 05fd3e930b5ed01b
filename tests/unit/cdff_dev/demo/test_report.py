# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The page of a demonstration holds what a reviewer looks for, and needs nothing beside itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cdff_common.interfaces.profile import Profile, Robot
from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import ElevationMap
from cdff_dev.demo.report import Process, Way, write_report
from cdff_dev.demo.run import Outcome
from cdff_dev.demo.script import Ask


def way(off_m: float = 0.0) -> Way:
    stamps = np.arange(5, dtype=np.int64) * 1000
    true = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
    covariances = np.tile(np.diag([0.04, 0.01, 0.01]), (5, 1, 1))
    found = true + np.array([0.0, off_m, 0.0])
    return Way("mana", stamps, found, covariances, dict(zip(stamps.tolist(), true, strict=True)))


def ground() -> ElevationMap:
    heights = np.random.default_rng(0).normal(size=(8, 8)).astype(np.float32)
    return ElevationMap.from_layers(GridGeometry("site", 1.0, -2.0, 4.0, 8, 8), {"mean": heights}, t0_ns=0, t1_ns=1000)


def asked(**wishes: object) -> Ask:
    return Ask(at_s=3, type="dem", robot="mana", max_age_s=2, deadline_ms=1000, **wishes)  # type: ignore[arg-type]


def test_a_way_says_how_far_off_the_truth_it_is() -> None:
    assert "5 poses, 4.0 m; off the truth: RMS 0.300 m, last 0.300 m" in way(0.3).line()


def test_a_way_without_truth_says_so() -> None:
    mine = way()
    assert "no truth" in Way("mana", mine.stamps_ns, mine.positions_m, mine.covariances, {}).line()


@pytest.mark.req("CDFF-SUP-193")
def test_the_page_holds_map_ways_requests_remarks_and_resources(tmp_path: Path) -> None:
    outcomes = [Outcome(asked(), (), 0.5, summary="ElevationMap"), Outcome(asked(), ("too <late>",), 9.0)]
    profile = Profile(name="test", doc="A test.", robots=(Robot(id="mana"),))
    page = tmp_path / "mission.html"
    write_report(page, "Mission test", profile, outcomes, ["ok"], [way(0.1)], ground(), [Process("dpm", 3.0, 80.0)])
    text = page.read_text(encoding="utf-8")
    for part in ("1 of 2 requests", "too &lt;late&gt;", "<polyline", "<ellipse", "data:image/png", "<td>dpm", "80 MB"):
        assert part in text
    assert "http" not in text


def test_without_any_way_there_is_no_map(tmp_path: Path) -> None:
    page = tmp_path / "mission.html"
    write_report(page, "Mission", Profile(name="test", robots=(Robot(id="mana"),)), [], [], [], None, [])
    assert "<svg" not in page.read_text(encoding="utf-8")

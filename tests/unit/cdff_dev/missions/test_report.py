# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The report page shows results, tasks, requests and resources, and escapes all texts."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from cdff_common.raster.geometry import GridGeometry
from cdff_common.types import ElevationMap
from cdff_dev.missions.autonomy import Arrival, RequestRecord
from cdff_dev.missions.report import Process, Report, write_report
from cdff_dev.missions.requests import Outcome
from cdff_dev.missions.script import GoTo, TimedRequest
from cdff_dev.missions.tracks import Track, Truth

S = 1_000_000_000
GO = GoTo(do="go_to", xy_m=(4.0, 1.0))


class Page(HTMLParser):
    """Parsed page: its texts, its tags, and the tags that are still open."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.tags: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.tags.append(tag)
        if tag in ("table", "svg", "h2"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag in ("table", "svg", "h2"):
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    def __contains__(self, text: str) -> bool:
        return text in "".join(self.texts)


def track() -> Track:
    """Return five poses along x, 0.1 m to the left of the true poses."""
    stamps_ns = np.arange(5, dtype=np.int64) * S
    true = np.tile(np.eye(4), (5, 1, 1))
    true[:, 0, 3] = np.arange(5.0)
    poses = true.copy()
    poses[:, 1, 3] += 0.1
    return Track("mana", stamps_ns, poses, np.tile(0.01 * np.eye(3), (5, 1, 1)), Truth(stamps_ns, true))


def ground() -> ElevationMap:
    heights = np.random.default_rng(0).normal(size=(8, 8)).astype(np.float32)
    geometry = GridGeometry("site", 1.0, -2.0, 4.0, 8, 8)
    return ElevationMap.from_layers(geometry, {"mean": heights}, t0_ns=0, t1_ns=1000)


def report(faults: tuple[str, ...] = (), request_faults: tuple[str, ...] = ()) -> Report:
    request = TimedRequest(at_s=3, type="dem", robot="mana", max_age_s=2, deadline_ms=1000)
    return Report(
        title="out & <back>",
        paragraphs=["Rock & roll <b>.", "A <profile>."],
        faults=faults,
        tracks=[track()],
        ground=ground(),
        outcomes=[Outcome(request, request_faults, 0.5, summary="ElevationMap")],
        processes=[Process("dpm", 3.0, 80.0)],
        arrivals=[Arrival("mana", GO, 4 * S, (4.0, 1.0))],
        guidance_requests=[
            RequestRecord(1, "mana", "pose", 0.1, "answer 1"),
            RequestRecord(3, "mana", "pose", 0.5, "answer 3"),
            RequestRecord(2.0, "mana", "navigation_map", 1.5, "<90 x 90> cells"),
        ],
    )


def page(tmp_path: Path, content: Report) -> Page:
    path = tmp_path / "mission.html"
    write_report(path, content)
    text = path.read_text(encoding="utf-8")
    assert "http" not in text  # the page refers to no other file
    return Page(text)


@pytest.mark.req("CDFF-DEV-074", "CDFF-SUP-193")
def test_the_page_holds_map_paths_tasks_requests_and_resources(tmp_path: Path) -> None:
    content = page(tmp_path, report())
    assert not content.open
    assert content.tags.count("svg") == 2
    assert {"polyline", "ellipse", "image"} <= set(content.tags)
    for text in (
        "5 poses, 4.0 m; position error: RMS 0.100 m",
        "go_to (4, 1)",
        "4 s",
        "navigation_map",
        "0.30 s",
        "0.50 s",
        "answer 3 at 3 s",
        "ElevationMap",
        "dpm",
        "80 MB",
    ):
        assert text in content


def test_texts_are_escaped(tmp_path: Path) -> None:
    content = page(tmp_path, report(("mana: <script>alert(1)</script>",), ("too <late>",)))
    assert not {"script", "back", "b", "profile", "late"} & set(content.tags)
    for text in (
        "out & <back>",
        "Rock & roll <b>.",
        "A <profile>.",
        "<script>alert(1)",
        "too <late>",
        "<90 x 90>",
    ):
        assert text in content


def test_faults_are_on_the_page(tmp_path: Path) -> None:
    content = page(tmp_path, report(("mana: no track on",), ("too late",)))
    assert "mana: no track on" in content
    assert "too late" in content


def test_without_tracks_there_is_no_map(tmp_path: Path) -> None:
    assert "svg" not in page(tmp_path, replace(report(), tracks=[])).tags

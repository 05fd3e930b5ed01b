# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The page of a mission holds score, tasks and requests, and is sound HTML whatever the names are."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from cdff_common.interfaces.profile import Profile, Robot
from cdff_dev.demo.report import Process, Way
from cdff_dev.demo.run import Outcome
from cdff_dev.demo.script import Ask
from cdff_dev.missions.autonomy import Arrival, Asked
from cdff_dev.missions.report import write
from cdff_dev.missions.run import Result
from cdff_dev.missions.score import Located, Reached, Score
from cdff_dev.missions.script import GoTo, Mission
from cdff_dev.missions.terrain import Driven, Mapped

S = 1_000_000_000
GO = GoTo(do="go_to", xy_m=(4.0, 1.0))


class Page(HTMLParser):
    """Texts and tags of a page; counts what is opened and not closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.texts: list[str] = []
        self.seen: list[str] = []
        self.open: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.seen.append(tag)
        if tag in ("table", "svg", "h2"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        if tag in ("table", "svg", "h2"):
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.texts.append(data)

    def __contains__(self, text: str) -> bool:
        return text in "".join(self.texts)


def result(unfinished: tuple[str, ...] = (), faults: tuple[str, ...] = ()) -> Result:
    stamps_ns = np.arange(5, dtype=np.int64) * S
    true = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
    covariances = np.tile(0.01 * np.eye(3), (5, 1, 1))
    way = Way(
        "mana", stamps_ns, true + np.array([0, 0.1, 0]), covariances, dict(zip(stamps_ns.tolist(), true, strict=True))
    )
    score = Score(
        (Located("mana", 100.0, 0.1, 0.2, 0.1, 0.99),), (Reached("mana", "(4, 1)", 0.3),),
        (Driven("mana", 20, 12.0, 0.1, 0, 0, 20.0, 0.2),), Mapped(400, 0.01, 0.03, 0.02), unfinished,
    )  # fmt: skip
    asked = [Asked(t, "mana", what, took, f"answer {t}") for t, what, took in ((1, "pose", 0.1), (3, "pose", 0.5))]
    asked.append(Asked(2.0, "mana", "navigation_map", 1.5, "<90 x 90> cells"))
    ask = Ask(at_s=3, type="dem", robot="mana", max_age_s=2, deadline_ms=1000)
    mission = Mission(doc="Rock & roll <b>.", profile="p", scenario="s", robots={"mana": (GO,)})
    return Result(
        mission, Profile(name="p", doc="A <profile>.", robots=(Robot(id="mana"),)), score, tuple(asked),
        (Arrival("mana", GO, 4 * S, (4.0, 1.0), (4.0, 1.0)),), (Outcome(ask, faults, 0.5, summary="ElevationMap"),),
        ("seen <each> other",), (), (way,), None, (Process("dpm", 3.0, 80.0),), 0, 4.0, 1.0,
    )  # fmt: skip


def page(tmp_path: Path, made: Result) -> Page:
    path = tmp_path / "mission.html"
    write(path, "out & <back>", made)
    return Page(path.read_text(encoding="utf-8"))


@pytest.mark.req("CDFF-DEV-074")
def test_the_page_holds_score_tasks_requests_and_resources(tmp_path: Path) -> None:
    made = page(tmp_path, result())
    assert not made.open
    assert made.seen.count("svg") == 2
    for text in (
        "All that the mission demands holds", "100 m driven", "(4, 1), truly 0.30 m off", "steepest 12.0 deg",
        "over 400 cells", "go_to (4, 1)", "4 s", "navigation_map", "0.30 s", "0.50 s", "answer 3 at 3 s",
        "ElevationMap", "80 MB",
    ):  # fmt: skip
        assert text in made


def test_what_others_wrote_is_shown_as_it_is_and_not_as_html(tmp_path: Path) -> None:
    made = page(tmp_path, result(("mana: <script>alert(1)</script>",), ("too <late>",)))
    assert not {"script", "back", "b", "profile", "late", "each"} & set(made.seen)
    for text in ("out & <back>", "Rock & roll <b>.", "A <profile>.", "<script>alert(1)", "too <late>", "<90 x 90>"):
        assert text in made


def test_faults_stand_on_the_page_instead_of_praise(tmp_path: Path) -> None:
    made = page(tmp_path, result(("mana: no way on",), ("too late",)))
    assert "mana: no way on" in made
    assert "too late" in made
    assert "All that the mission demands" not in made

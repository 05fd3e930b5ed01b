# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a job answers when time passes between its steps; the DPM is a script, the mission clock a hand."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from cdff_common.bus import Reply
from cdff_common.clock import ManualClock, monotonic_s
from cdff_common.errors import DeadlineError, FrameNotFoundError, UnavailableError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header, product_id
from cdff_common.interfaces.profile import load_profile
from cdff_common.types import TransformWithCovariance
from cdff_core.orchestration.judge import Candidate, Judgement, judge
from cdff_core.orchestration.request import ProductRequest, parse_request
from services.orchestrator.delivery import Delivery
from services.orchestrator.finder import Found
from services.orchestrator.flow import Flow
from services.orchestrator.jobs import JobBook
from services.orchestrator.journal import Journal
from services.orchestrator.planning import Planning
from services.orchestrator.sharing import Result
from services.orchestrator.state import State

PROFILE = Path(__file__).parents[4] / "deploy" / "profiles" / "rover_traverse.yaml"
S = 1_000_000_000


def pose(t1_ns: int) -> Found:
    """A stored pose of mana's base."""
    T = UncertainTransform(np.eye(4), np.eye(6))
    value = TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=t1_ns)
    name = product_id("mana", "position_manager", "pose", t1_ns, 0, "")
    header = Header(name, 0, t1_ns, t1_ns, "site", "position_manager", child="mana/base")
    return Found(Candidate(name, "mana", t1_ns, t1_ns), (header,), value, "site", "mana/base", whole=True)


class Script:
    """A finder that gives one thing after the other, the last one again and again; time passes after each look."""

    def __init__(self, clock: ManualClock, passes_ns: int, *looks: Found | Exception | None) -> None:
        self.clock, self.passes_ns, self.looks, self.times = clock, passes_ns, looks, 0
        self.frames = {"world"}

    def find(self, request: ProductRequest, robots: Sequence[str], until_s: float) -> Result:
        look = self.looks[min(self.times, len(self.looks) - 1)]
        self.times += 1
        if isinstance(look, DeadlineError):  # as a call that lasts as long as it may
            threading.Event().wait(until_s - monotonic_s())
        if isinstance(look, Exception):
            raise look
        if look is None:
            return None, "nothing there"
        judgement: Judgement = judge(look.candidate, request, self.clock.now_ns())
        self.clock.set_ns(self.clock.now_ns() + self.passes_ns)
        return (look, judgement), "; ".join(judgement.missing)

    def cover(self, *arguments: object) -> None:
        return None

    def knows_frame(self, frame: str, robots: Sequence[str], until_s: float) -> bool:
        return frame in self.frames


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    made = Journal(tmp_path / "journal.jsonl")
    yield made
    made.close()


def answer(journal: Journal, script: Script, **asked: str) -> list[Reply]:
    state = State(load_profile(PROFILE))
    book = JobBook(journal, 4, wake=state.touch)
    planning = Planning(state, script, script.clock)  # type: ignore[arg-type]
    flow = Flow(state, script, planning, Delivery(None, script.clock), book, journal, script.clock)  # type: ignore[arg-type]
    request = parse_request({"type": "pose", "deadline_ms": "1500", **asked}, "mana")
    return list(flow.run(request))


def test_what_is_too_old_when_it_is_sent_is_not_sent_but_the_next_one_is(journal: Journal) -> None:
    clock = ManualClock(100 * S)
    script = Script(clock, S, pose(99 * S), pose(102 * S))
    (reply,) = answer(journal, script, max_age_s="1.5", deadline_ms="4000")
    assert script.times == 2
    assert reply.attachment["t1_ns"] == 102 * S
    assert reply.attachment["delivered"]["age_s"] <= 1.5
    states = [r["state"] for r in journal.records() if r["kind"] == "job"]
    assert states[:4] == ["received", "looking", "delivering", "waiting"]
    assert states[-2:] == ["delivering", "done"]


def test_what_grows_too_old_each_time_ends_as_deadline(journal: Journal) -> None:
    clock = ManualClock(100 * S)
    with pytest.raises(DeadlineError, match="age"):
        answer(journal, Script(clock, S, pose(99 * S)), max_age_s="1.5")


def test_running_out_of_our_own_time_is_not_told_as_the_dpm_s_failure(journal: Journal) -> None:
    script = Script(ManualClock(S), 0, None, DeadlineError("no time left to ask the DPM"))
    with pytest.raises(DeadlineError) as late:
        answer(journal, script, max_age_s="0.1", request="mine")
    assert "the DPM:" not in str(late.value)
    assert late.value.request == "mine"


def test_a_dpm_that_does_not_answer_is_told(journal: Journal) -> None:
    with pytest.raises(UnavailableError, match="the DPM: away") as down:
        answer(journal, Script(ManualClock(S), 0, UnavailableError("away")))
    assert not isinstance(down.value, DeadlineError)


def test_a_frame_of_the_mission_or_of_the_dpm_may_be_asked_for_another_one_is_not_found(journal: Journal) -> None:
    with pytest.raises(FrameNotFoundError, match="nosuch"):
        answer(journal, Script(ManualClock(S), 0, None), frame="nosuch")
    for known in ("world", "mana/odom", "mana/lidar"):
        with pytest.raises(DeadlineError):
            answer(journal, Script(ManualClock(S), 0, None), frame=known, deadline_ms="150")


def test_nothing_in_a_region_that_must_be_covered_is_unavailable(journal: Journal) -> None:
    asked = {"type": "dem", "region": "circle:0,0,5", "deadline_ms": "150"}
    with pytest.raises(UnavailableError) as refused:
        answer(journal, Script(ManualClock(S), 0, None), min_coverage="0.5", **asked)
    assert not isinstance(refused.value, DeadlineError)
    with pytest.raises(UnavailableError) as empty:
        answer(journal, Script(ManualClock(S), 0, None), **asked)
    assert not isinstance(empty.value, DeadlineError)


def test_progress_is_told_to_who_wants_it(journal: Journal) -> None:
    script = Script(ManualClock(100 * S), 0, pose(99 * S))
    assert [r.attachment["kind"] for r in answer(journal, script)] == ["product"]
    assert [r.attachment["kind"] for r in answer(journal, script, progress="true")] == ["progress", "product"]

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replies to a request when time passes between its steps; search results are scripted."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from cdff_common.bus import Reply, without_pauses
from cdff_common.clock import ManualClock, monotonic_s
from cdff_common.errors import DeadlineError, FrameNotFoundError, UnavailableError
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import Header, product_id
from cdff_common.interfaces.profile import load_profile
from cdff_common.types import TransformWithCovariance
from cdff_core.orchestration.acceptance import Assessment, ProductCandidate, assess
from cdff_core.orchestration.request import ProductRequest, parse_request
from services.orchestrator.jobs import JobRegistry
from services.orchestrator.journal import Journal
from services.orchestrator.planning import RequestPlanner
from services.orchestrator.product_finder import ProductMatch
from services.orchestrator.reply import ReplyBuilder
from services.orchestrator.request_flow import RequestFlow
from services.orchestrator.shared_queries import Result
from services.orchestrator.state import SystemState

PROFILE = Path(__file__).parents[4] / "deploy" / "profiles" / "rover_traverse.yaml"
S = 1_000_000_000


def pose(t1_ns: int) -> ProductMatch:
    """Return a stored pose of mana's base."""
    T = UncertainTransform(np.eye(4), np.eye(6))
    value = TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=t1_ns)
    name = product_id("mana", "position_manager", "pose", t1_ns, 0, "")
    header = Header(name, 0, t1_ns, t1_ns, "site", "position_manager", child="mana/base")
    return ProductMatch(
        ProductCandidate(name, "mana", t1_ns, t1_ns),
        (header,),
        value,
        "site",
        "mana/base",
        is_unmodified=True,
    )


class ScriptedFinder:
    """Finder double that gives results in order and repeats the last; time passes after each search."""

    def __init__(self, clock: ManualClock, passes_ns: int, *results: ProductMatch | Exception | None) -> None:
        self.clock, self.passes_ns, self.results, self.search_count = clock, passes_ns, results, 0
        self.frames = {"world"}

    def find(self, request: ProductRequest, robots: Sequence[str], until_s: float) -> Result:
        result = self.results[min(self.search_count, len(self.results) - 1)]
        self.search_count += 1
        if isinstance(result, DeadlineError):  # a call that lasts until its deadline
            threading.Event().wait(until_s - monotonic_s())
        if isinstance(result, Exception):
            raise result
        if result is None:
            return None, "no product"
        assessment: Assessment = assess(result.candidate, request, self.clock.now_ns())
        self.clock.set_ns(self.clock.now_ns() + self.passes_ns)
        return (result, assessment), "; ".join(assessment.violations)

    def coverage(self, *arguments: object) -> None:
        return None

    def has_frame(self, frame: str, robots: Sequence[str], until_s: float) -> bool:
        return frame in self.frames


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    journal = Journal(tmp_path / "journal.jsonl")
    yield journal
    journal.close()


def answer(journal: Journal, finder: ScriptedFinder, **parameters: str) -> list[Reply]:
    state = SystemState(load_profile(PROFILE))
    registry = JobRegistry(journal, 4)
    planning = RequestPlanner(state, finder, finder.clock)  # type: ignore[arg-type]
    flow = RequestFlow(
        state, finder, planning, ReplyBuilder(None, finder.clock), registry, journal, finder.clock
    )  # type: ignore[arg-type]
    request = parse_request({"type": "pose", "deadline_ms": "1500", **parameters}, "mana")
    return list(without_pauses(flow.run(request)))


def test_a_product_too_old_at_delivery_is_replaced_by_the_next(journal: Journal) -> None:
    clock = ManualClock(100 * S)
    finder = ScriptedFinder(clock, S, pose(99 * S), pose(102 * S))
    (reply,) = answer(journal, finder, max_age_s="1.5", deadline_ms="4000")
    assert finder.search_count == 2
    assert reply.attachment["t1_ns"] == 102 * S
    assert reply.attachment["delivered"]["age_s"] <= 1.5
    states = [r["state"] for r in journal.records() if r["kind"] == "job"]
    assert states[:4] == ["received", "looking", "delivering", "waiting"]
    assert states[-2:] == ["delivering", "done"]


def test_the_journal_has_kind_id_and_delivery_of_the_result(journal: Journal) -> None:
    (reply,) = answer(journal, ScriptedFinder(ManualClock(100 * S), 0, pose(99 * S)))
    done = [r for r in journal.records() if r["kind"] == "job"][-1]
    assert done["state"] == "done"
    assert done["result"] == {name: reply.attachment[name] for name in ("kind", "id", "delivered")}
    assert done["result"]["id"] == pose(99 * S).candidate.id


def test_a_request_with_only_outdated_products_ends_at_its_deadline(journal: Journal) -> None:
    clock = ManualClock(100 * S)
    with pytest.raises(DeadlineError, match="age"):
        answer(journal, ScriptedFinder(clock, S, pose(99 * S)), max_age_s="1.5")


def test_the_deadline_of_the_request_is_not_reported_as_a_dpm_failure(journal: Journal) -> None:
    finder = ScriptedFinder(ManualClock(S), 0, None, DeadlineError("no time left to ask the DPM"))
    with pytest.raises(DeadlineError) as error:
        answer(journal, finder, max_age_s="0.1", request="mine")
    assert "the DPM:" not in str(error.value)
    assert error.value.request == "mine"


def test_an_unresponsive_dpm_is_reported(journal: Journal) -> None:
    with pytest.raises(UnavailableError, match="the DPM: away") as error:
        answer(journal, ScriptedFinder(ManualClock(S), 0, UnavailableError("away")))
    assert not isinstance(error.value, DeadlineError)


def test_existing_frames_are_accepted_and_others_are_not_found(
    journal: Journal,
) -> None:
    with pytest.raises(FrameNotFoundError, match="nosuch"):
        answer(journal, ScriptedFinder(ManualClock(S), 0, None), frame="nosuch")
    for frame in ("world", "mana/odom", "mana/lidar"):
        with pytest.raises(DeadlineError):
            answer(journal, ScriptedFinder(ManualClock(S), 0, None), frame=frame, deadline_ms="150")


def test_a_region_without_data_is_unavailable(journal: Journal) -> None:
    parameters = {"type": "dem", "region": "circle:0,0,5", "deadline_ms": "150"}
    with pytest.raises(UnavailableError) as with_coverage:
        answer(journal, ScriptedFinder(ManualClock(S), 0, None), min_coverage="0.5", **parameters)
    assert not isinstance(with_coverage.value, DeadlineError)
    with pytest.raises(UnavailableError) as without_coverage:
        answer(journal, ScriptedFinder(ManualClock(S), 0, None), **parameters)
    assert not isinstance(without_coverage.value, DeadlineError)


def test_progress_is_sent_to_clients_that_ask_for_it(journal: Journal) -> None:
    finder = ScriptedFinder(ManualClock(100 * S), 0, pose(99 * S))
    assert [r.attachment["kind"] for r in answer(journal, finder)] == ["product"]
    assert [r.attachment["kind"] for r in answer(journal, finder, progress="true")] == ["progress", "product"]

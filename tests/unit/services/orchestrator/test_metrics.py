# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Counters of the orchestrator from its journal, and their form in ``/metrics``."""

from __future__ import annotations

from pathlib import Path

from services.dpm.http.metrics import orchestrator_lines
from services.orchestrator.journal import Journal
from services.orchestrator.metrics import Metrics


def test_requests_actions_and_answer_times_are_counted_from_the_journal(tmp_path: Path) -> None:
    metrics = Metrics()
    journal = Journal(tmp_path / "j.jsonl")
    journal.listen(metrics.on_record)
    for job, last_state in (("1", "done"), ("2", "failed"), ("3", "waiting")):
        journal.append("job", job=job, state="received", request={"type": "dem"})
        journal.append("job", job=job, state=last_state)
    journal.append("activation", dfpc="mana/dem", action="activate", ok=True)
    journal.append("mode", sensor="mana/lidar", ok=False)
    journal.close()
    counters = metrics.to_dict()
    assert counters["open"] == 1
    assert counters["requests"] == [
        {"type": "dem", "state": "done", "count": 1},
        {"type": "dem", "state": "failed", "count": 1},
    ]
    assert {(a["verb"], a["ok"]): a["count"] for a in counters["actions"]} == {
        ("activate", True): 1,
        ("set_mode", False): 1,
    }
    lines = orchestrator_lines(counters)
    assert 'cdff_orchestrator_requests_total{type="dem",state="done"} 1' in lines
    assert 'cdff_orchestrator_actions_total{verb="set_mode",ok="false"} 1' in lines
    assert 'cdff_orchestrator_answer_seconds_bucket{le="+Inf"} 2' in lines
    buckets = [int(line.rsplit(" ", 1)[1]) for line in lines if "_bucket" in line]
    assert buckets == sorted(buckets)


def test_an_unavailable_orchestrator_is_reported_as_down() -> None:
    assert orchestrator_lines(None)[-1] == "cdff_orchestrator_up 0"


def test_jobs_started_before_this_process_are_not_counted(tmp_path: Path) -> None:
    metrics = Metrics()
    journal = Journal(tmp_path / "j.jsonl")
    journal.listen(metrics.on_record)
    journal.append("job", job="old", state="failed", reason="the orchestrator was restarted")
    journal.close()
    assert metrics.to_dict()["requests"] == []

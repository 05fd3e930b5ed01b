# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The journal on disk and the job registry."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

from cdff_common.clock import ManualClock
from cdff_common.errors import (
    ConflictError,
    InputError,
    OverloadedError,
    ProductNotFoundError,
    StorageError,
    UnavailableError,
)
from cdff_core.orchestration.journal import recover
from cdff_core.orchestration.lifecycle import JobState
from cdff_core.orchestration.request import ProductRequest
from services.orchestrator.jobs import JobRegistry
from services.orchestrator.journal import Journal


def test_appended_records_are_read_in_order_also_by_the_next_process(tmp_path: Path) -> None:
    path = tmp_path / "a" / "journal.jsonl"
    journal = Journal(path)
    journal.append("start", open_jobs=0)
    journal.append("mode", sensor="mana/lidar", ok=True)
    journal.close()
    reopened = Journal(path)
    reopened.append("start", open_jobs=1)
    assert [(r["kind"], r.get("open_jobs")) for r in reopened.records()] == [
        ("start", 0),
        ("mode", None),
        ("start", 1),
    ]
    reopened.close()
    with pytest.raises(StorageError):
        reopened.append("start")


def test_a_truncated_last_line_is_removed_and_invalid_lines_are_skipped(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_bytes(b'{"kind":"start"}\nnonsense\n[1]\n{"kind":"mode"}\n{"kind":"jo')
    journal = Journal(path)
    journal.append("job", job="1", state="received")
    assert [r["kind"] for r in journal.records()] == ["start", "mode", "job"]
    journal.close()


@pytest.mark.parametrize("progress", [True, False])
def test_only_the_end_of_a_job_with_progress_is_written_to_the_disk_at_once(
    tmp_path: Path, progress: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal, durable = Journal(tmp_path / "journal.jsonl"), list[bool]()
    monkeypatch.setattr(journal, "append", lambda *_, **values: durable.append(values.get("durable", True)))
    jobs = JobRegistry(journal, 4)
    job = jobs.open(ProductRequest("1", "pose", "mana", progress=progress))
    durable.clear()
    for state in (JobState.LOOKING, JobState.DELIVERING, JobState.DONE):
        jobs.move(job, state)
    assert durable == [False, False, progress]
    journal.close()


def test_a_compacted_journal_continues_from_its_summary_and_the_old_one_is_kept(
    tmp_path: Path,
) -> None:
    path = tmp_path / "journal.jsonl"
    journal = Journal(path)
    for i in range(5):
        journal.append("job", job=str(i), state="done")
    size_before = journal.size
    journal.compact([{"kind": "mode", "sensor": "mana/lidar", "ok": True}])
    journal.append("start")
    assert [r["kind"] for r in journal.records()] == ["mode", "start"]
    assert journal.size < size_before
    assert len((tmp_path / "journal.1.jsonl").read_text().splitlines()) == 5
    journal.close()


def test_concurrent_appends_share_an_fsync_and_return_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "journal.jsonl"
    journal, synced_sizes, original_fsync = Journal(path), [], os.fsync
    deadline_s = time.monotonic() + 20

    def fsync_once_all_have_written(fd: int) -> None:
        while path.read_bytes().count(b"\n") < 9 and time.monotonic() < deadline_s:
            time.sleep(0.001)
        original_fsync(fd)
        synced_sizes.append(path.stat().st_size)

    monkeypatch.setattr(os, "fsync", fsync_once_all_have_written)

    def append(index: int) -> int:
        journal.append("job", job=str(index))
        return max(synced_sizes)

    with ThreadPoolExecutor(9) as pool:
        durable_sizes = list(pool.map(append, range(9)))
    assert sorted(r["job"] for r in journal.records()) == [str(i) for i in range(9)]
    assert len(synced_sizes) <= 2  # one that may have started before all have written, and a second one
    assert max(durable_sizes) == journal.size
    journal.close()


@pytest.mark.parametrize("content", [b"", b"truncated", b"\n"])
def test_a_journal_without_a_complete_record_is_empty(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_bytes(content)
    journal = Journal(path)
    assert [r for r in journal.records() if r] == []
    journal.close()


@pytest.fixture
def journal(tmp_path: Path) -> Iterator[Journal]:
    journal = Journal(tmp_path / "journal.jsonl")
    yield journal
    journal.close()


def request(name: str, robot: str = "mana") -> ProductRequest:
    return ProductRequest(name, "pose", robot)


def test_excess_jobs_are_refused_with_a_time_to_retry(journal: Journal) -> None:
    registry = JobRegistry(journal, capacity=2)
    first = registry.open(request("a"))
    registry.open(request("b"))
    with pytest.raises(OverloadedError) as refusal:
        registry.open(request("c"))
    assert refusal.value.retry_after_s > 0
    registry.move(first, JobState.FAILED, "because")
    registry.open(request("c"))


def test_open_jobs_are_listed_without_ended_ones(journal: Journal) -> None:
    registry = JobRegistry(journal, capacity=3)
    ended, first, second = (registry.open(request(name)) for name in ("a", "b", "c"))
    registry.move(ended, JobState.FAILED, "because")
    registry.add_ended([{"job": "past", "request": {"request": "old", "robot": "mana"}}])
    assert [j["job"] for j in registry.listed({"mana"}, 9)] == [second.id, first.id, ended.id, "past"]
    assert [j["job"] for j in registry.listed({"mana"}, 9, only_open=True)] == [second.id, first.id]
    assert [j["job"] for j in registry.listed({"mana"}, 1, only_open=True)] == [second.id]
    assert registry.listed({"minnie"}, 9, only_open=True) == []


def test_jobs_state_the_mission_times_of_their_start_and_end_also_after_a_restart(tmp_path: Path) -> None:
    clock = ManualClock(1000)
    journal = Journal(tmp_path / "mission.jsonl", clock)
    registry = JobRegistry(journal, capacity=3)
    ended, running = (registry.open(request(name)) for name in ("a", "b"))
    clock.set_ns(2000)
    registry.move(ended, JobState.FAILED, "because")
    registry.move(running, JobState.LOOKING)
    times = {job["job"]: (job["opened_ns"], job["ended_ns"]) for job in registry.listed({"mana"}, 9)}
    assert times == {ended.id: (1000, 2000), running.id: (1000, None)}
    recovered = recover(journal.records())
    jobs = [*recovered.ended, *recovered.interrupted_jobs("restarted")]
    assert {job["job"]: (job["opened_ns"], job["ended_ns"]) for job in jobs} == times | {
        running.id: (1000, 2000)  # nothing is known of it after its last record
    }
    journal.close()


@pytest.mark.req("CDFF-SUP-072")
def test_the_last_job_of_lowest_priority_is_evicted_for_a_higher_one(journal: Journal) -> None:
    registry = JobRegistry(journal, capacity=3)
    jobs = [registry.open(replace(request(name), priority=p)) for name, p in (("a", 5), ("b", 2), ("c", 2))]
    high = registry.open(replace(request("high"), priority=9))
    assert [job.changed.is_set() for job in jobs] == [False, False, True]
    with pytest.raises(OverloadedError, match="higher priority") as refusal:
        jobs[2].check_cancelled()
    assert refusal.value.retry_after_s > 0
    for job in (*jobs[:2], high):
        job.check_cancelled()
    registry.open(replace(request("next"), priority=3))
    with pytest.raises(OverloadedError):
        jobs[1].check_cancelled()
    with pytest.raises(OverloadedError):
        registry.open(replace(request("low"), priority=3))


def test_a_job_in_delivery_is_not_evicted(journal: Journal) -> None:
    registry = JobRegistry(journal, capacity=1)
    job = registry.open(replace(request("a"), priority=0))
    registry.move(job, JobState.LOOKING)
    registry.move(job, JobState.DELIVERING)
    with pytest.raises(OverloadedError):
        registry.open(replace(request("b"), priority=9))


def test_a_request_name_can_be_reused_after_its_job(journal: Journal) -> None:
    registry = JobRegistry(journal, capacity=9)
    job = registry.open(request("a"))
    with pytest.raises(InputError, match="a"):
        registry.open(request("a"))
    registry.move(job, JobState.CANCELLED)
    assert registry.get("a") is job
    assert registry.get(registry.open(request("a")).id).state is JobState.RECEIVED
    with pytest.raises(ProductNotFoundError):
        registry.get("z")
    with pytest.raises(ConflictError):
        registry.move(job, JobState.LOOKING)


def test_only_an_open_standing_request_can_be_renewed(journal: Journal) -> None:
    registry = JobRegistry(journal, capacity=9)
    standing = registry.open(replace(request("s"), every_s=0.0, deadline_s=1.0))
    assert registry.renew("s", 100.0).remaining_s() > 90
    registry.open(request("once"))
    with pytest.raises(InputError, match="standing"):
        registry.renew("once", 5.0)
    registry.move(standing, JobState.CANCELLED)
    for name in ("s", "never"):
        with pytest.raises(ProductNotFoundError):
            registry.renew(name, 5.0)


def test_old_jobs_are_removed_and_lists_start_with_the_newest(journal: Journal) -> None:
    registry = JobRegistry(journal, capacity=1, ended_limit=6)
    for i in range(12):
        registry.move(registry.open(request(f"r{i}", "mana" if i % 2 else "minnie")), JobState.FAILED)
    listed = registry.listed({"mana"}, 500)
    assert listed[0]["request"]["request"] == "r11"
    assert {j["request"]["robot"] for j in listed} == {"mana"}
    assert len(registry.listed({"mana", "minnie"}, 500)) == 7


def test_a_stopped_registry_ends_open_jobs_as_retriable_and_refuses_new_ones(journal: Journal) -> None:
    registry = JobRegistry(journal, capacity=9)
    job = registry.open(request("a"))
    registry.stop(0.0)
    with pytest.raises(UnavailableError, match="stopping") as refusal:
        job.check_cancelled()
    assert refusal.value.retry_after_s
    with pytest.raises(UnavailableError, match="stopping"):
        registry.open(request("b"))

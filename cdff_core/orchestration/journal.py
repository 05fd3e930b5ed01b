# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recovery of the orchestrator's state from the records of its journal after a restart."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cdff_core.orchestration.lifecycle import FINAL_STATES
from cdff_core.orchestration.world import ProviderId, SensorId

#: Maximum number of ended jobs that are restored.
_ENDED_JOBS = 200


@dataclass(slots=True)
class RecoveredState:
    """State of the orchestrator recovered from its records."""

    #: Last record of each job without a final state, by its id.
    open_jobs: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    held: set[ProviderId] = field(default_factory=set)  # providers with an unreleased lease
    #: Providers that the orchestrator has activated and not deactivated.
    owned: set[ProviderId] = field(default_factory=set)
    modes: set[SensorId] = field(default_factory=set)  # sensors whose mode was changed
    #: Scheduled requests that have not ended, by their id: the record, with the ids of the ``products``.
    scheduled: dict[str, dict[str, Any]] = field(default_factory=dict)
    jobs: int = 0  # number of accepted jobs
    #: Last ended jobs, oldest first, as entries of a job list.
    ended: list[dict[str, Any]] = field(default_factory=list)

    def interrupted_jobs(self, reason: str) -> list[dict[str, Any]]:
        """Return the open jobs as entries of a job list, failed for ``reason``."""
        return [
            _job_summary({**record, "job": job, "state": "failed", "reason": reason})
            for job, record in self.open_jobs.items()
        ]

    def records(self) -> list[dict[str, Any]]:
        """Return the records of this state for a compacted journal."""
        jobs = [{**record, "kind": "job", "job": job} for job, record in self.open_jobs.items()]
        owned = [
            {"kind": "activation", "dfpc": str(provider), "action": "activate", "ok": True}
            for provider in sorted(self.owned)
        ]
        modes = [{"kind": "mode", "sensor": str(s), "ok": True} for s in sorted(self.modes)]
        scheduled = [{**record, "kind": "schedule"} for record in self.scheduled.values()]
        return [*jobs, *owned, *modes, *scheduled]


def recover(records: Iterable[Mapping[str, Any]]) -> RecoveredState:
    """Return the state after all records in order; records of unknown kinds are skipped."""
    state = RecoveredState()
    leases: dict[str, set[ProviderId]] = {}
    for record in records:
        kind = record.get("kind")
        if kind == "job":
            job = str(record["job"])
            state.jobs += record["state"] == "received"
            if record["state"] in FINAL_STATES:
                state.ended.append(_job_summary({**state.open_jobs.pop(job, {}), **record}))
                del state.ended[:-_ENDED_JOBS]
            else:
                first = state.open_jobs.get(job, record)
                times = {
                    "accepted_ns": first.get("accepted_ns", record.get("at_ns")),
                    "opened_ns": first.get("opened_ns", record.get("stamp_ns")),
                }
                state.open_jobs[job] = {**state.open_jobs.get(job, {}), **record, **times}
        elif kind == "lease":
            if record["action"] == "acquire":
                leases.setdefault(str(record["holder"]), set()).update(
                    parse_provider_id(text) for text in record["providers"]
                )
            else:
                leases.pop(str(record["holder"]), None)
        elif kind == "activation" and record.get("ok"):
            if record["action"] == "activate":
                state.owned.add(parse_provider_id(str(record["dfpc"])))
            elif record["action"] in ("deactivate", "clean_up"):
                state.owned.discard(parse_provider_id(str(record["dfpc"])))
        elif kind == "control" and record["action"] == "hand_back":
            robot = str(record["robot"])
            state.owned = {p for p in state.owned if p.robot != robot}
            state.modes = {s for s in state.modes if s.robot != robot}
        elif kind == "schedule":
            _add_schedule(state.scheduled, record)
        elif kind == "mode" and record.get("ok") and "acquired" not in record:
            state.modes.add(SensorId(*parse_provider_id(str(record["sensor"]))))
    state.held = {provider for providers in leases.values() for provider in providers}
    return state


def _add_schedule(scheduled: dict[str, dict[str, Any]], record: Mapping[str, Any]) -> None:
    """Add a record of a scheduled request to those that have not ended."""
    name, action = str(record["request"]), record["action"]
    if action == "add":
        scheduled[name] = {"products": [], **record}
    elif action == "product" and name in scheduled:
        scheduled[name]["products"].append(str(record["product"]))
    elif action == "end":
        scheduled.pop(name, None)


def _job_summary(record: Mapping[str, Any]) -> dict[str, Any]:
    """Return the job list entry of an ended job from its merged records."""
    return {
        "job": str(record["job"]),
        "state": str(record["state"]),
        "reason": str(record.get("reason", "")),
        "accepted_ns": record.get("accepted_ns", record.get("at_ns")),
        "opened_ns": record.get("opened_ns", record.get("stamp_ns")),
        "ended_ns": record.get("stamp_ns"),
        "remaining_s": None,
        "request": dict(record.get("request") or {}),
        "plan": record.get("plan"),
        "result": record.get("result"),
    }


def parse_provider_id(text: str) -> ProviderId:
    """Return the ``ProviderId`` of a text ``robot/dfpc``."""
    robot, _, dfpc = text.partition("/")
    return ProviderId(robot, dfpc)

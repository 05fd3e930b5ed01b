# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the orchestrator's journal says, as plain records, and what is left of them after a restart."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cdff_core.orchestration.lifecycle import FINAL_STATES
from cdff_core.orchestration.world import MakerId, SensorId

#: Ended jobs that are remembered over a restart.
_REMEMBERED = 200
#: Kinds of records: job (state changes), lease (acquire, release), mode, activation, decision, start.
KINDS = frozenset({"start", "job", "lease", "mode", "activation", "decision"})


@dataclass(slots=True)
class Recovered:
    """State that the records lead to.

    Attributes
    ----------
    open_jobs : dict of str to mapping
        Jobs without a final state, by id, with their last record.
    held : set of MakerId
        Makers that some holder had not let go of.
    owned : set of MakerId
        Makers that were activated and not deactivated.
    modes : set of SensorId
        Sensors whose mode was changed.
    jobs : int
        How many were ever accepted.
    ended : list of mapping
        The last jobs that ended, oldest first, as job lists describe them.
    """

    open_jobs: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    held: set[MakerId] = field(default_factory=set)
    owned: set[MakerId] = field(default_factory=set)
    modes: set[SensorId] = field(default_factory=set)
    jobs: int = 0
    ended: list[dict[str, Any]] = field(default_factory=list)

    def broken_off(self, reason: str) -> list[dict[str, Any]]:
        """The open jobs as failed ones, for ``reason``."""
        return [
            _described({**record, "job": job, "state": "failed", "reason": reason})
            for job, record in self.open_jobs.items()
        ]

    def records(self) -> list[dict[str, Any]]:
        """Records that lead to the same state, for a journal that starts anew."""
        jobs = [{**record, "kind": "job", "job": job} for job, record in self.open_jobs.items()]
        owned = [{"kind": "activation", "dfpc": str(m), "action": "activate", "ok": True} for m in sorted(self.owned)]
        modes = [{"kind": "mode", "sensor": str(s), "ok": True} for s in sorted(self.modes)]
        return [*jobs, *owned, *modes]


def recover(records: Iterable[Mapping[str, Any]]) -> Recovered:
    """Replay records in order; those of unknown kinds are passed over: a newer version may have written them."""
    state = Recovered()
    leases: dict[str, set[MakerId]] = {}
    for record in records:
        kind = record.get("kind")
        if kind == "job":
            job = str(record["job"])
            state.jobs += record["state"] == "received"
            if record["state"] in FINAL_STATES:
                state.ended.append(_described({**state.open_jobs.pop(job, {}), **record}))
                del state.ended[:-_REMEMBERED]
            else:
                first_ns = state.open_jobs.get(job, record).get("accepted_ns", record.get("at_ns"))
                state.open_jobs[job] = {**state.open_jobs.get(job, {}), **record, "accepted_ns": first_ns}
        elif kind == "lease":
            if record["action"] == "acquire":
                leases.setdefault(str(record["holder"]), set()).update(maker_id(m) for m in record["makers"])
            else:
                leases.pop(str(record["holder"]), None)
        elif kind == "activation" and record.get("ok"):
            if record["action"] == "activate":
                state.owned.add(maker_id(str(record["dfpc"])))
            elif record["action"] in ("deactivate", "clean_up"):
                state.owned.discard(maker_id(str(record["dfpc"])))
        elif kind == "mode" and record.get("ok"):
            state.modes.add(SensorId(*maker_id(str(record["sensor"]))))
    state.held = {m for makers in leases.values() for m in makers}
    return state


def _described(record: Mapping[str, Any]) -> dict[str, Any]:
    """A job that ended, from all that its records said."""
    return {
        "job": str(record["job"]),
        "state": str(record["state"]),
        "reason": str(record.get("reason", "")),
        "accepted_ns": record.get("accepted_ns", record.get("at_ns")),
        "remaining_s": None,
        "request": dict(record.get("request") or {}),
        "plan": record.get("plan"),
        "result": record.get("result"),
    }


def maker_id(text: str) -> MakerId:
    """Inverse of ``str(MakerId)``."""
    robot, _, dfpc = text.partition("/")
    return MakerId(robot, dfpc)

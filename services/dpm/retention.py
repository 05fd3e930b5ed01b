# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``dpm/@rpc/retention``: the profile's rules of what may go, planned or applied."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from cdff_common.bus import Reply, Request
from cdff_common.errors import InputError
from cdff_common.interfaces.profile import Profile
from dpm_store import Plan, Prefer, Rule, Verdict
from services.dpm.operations import Dpm
from services.dpm.parameters import check_names

#: Verdicts in one reply.
MAX_TOLD = 1000


def rules_of(profile: Profile | None) -> tuple[Rule, ...]:
    """The rules of a profile; without one nothing may go."""
    if profile is None:
        return ()
    return tuple(Rule(**{**r.model_dump(), "prefer": Prefer(r.prefer)}) for r in profile.retention)


def retention(dpm: Dpm, rules: Sequence[Rule], request: Request) -> Reply | Iterator[Reply]:
    """What may go and why: ``{applied, rules, retired, bytes, kept, verdicts}``.

    With ``apply=true`` it is deleted, and its payloads are collected. With ``all=true`` every verdict is told, a
    thousand in a reply, before the final one with the sums; else the final one has the first thousand.
    """
    p = request.parameters
    check_names(p, frozenset({"apply", "all", "robot", "request"}))
    apply, every = flag(p, "apply"), flag(p, "all")
    if not every:
        return _final(dpm.retire(rules, apply=apply), len(rules), apply)
    return _in_parts(dpm, rules, apply)


def flag(parameters: Mapping[str, str], name: str) -> bool:
    """A parameter that is true or false, false by default; raises InputError for anything else."""
    text = parameters.get(name, "false")
    if text not in ("true", "false"):
        raise InputError(f"{name}={text[:20]!r}: expected true or false")
    return text == "true"


def _in_parts(dpm: Dpm, rules: Sequence[Rule], apply: bool) -> Iterator[Reply]:
    verdicts = dpm.store.retention.verdicts(rules)
    while part := tuple(itertools.islice(verdicts, MAX_TOLD)):
        yield Reply.of({"verdicts": [_told(v) for v in part]}, kind="progress", final=False)
    yield _final(dpm.retire(rules, apply=apply), len(rules), apply, verdicts=False)


def plan_told(plan: Plan, rules: int, applied: bool, *, verdicts: bool = True) -> dict[str, Any]:
    """A plan as plain data, with its first verdicts where wanted."""
    told = [_told(v) for v in plan.verdicts[:MAX_TOLD]] if verdicts else []
    return {
        "applied": applied, "rules": rules, "retired": plan.going, "bytes": plan.bytes, "kept": plan.staying,
        "verdicts": told,
    }  # fmt: skip


def _final(plan: Plan, rules: int, applied: bool, *, verdicts: bool = True) -> Reply:
    return Reply.of(plan_told(plan, rules, applied, verdicts=verdicts))


def _told(v: Verdict) -> dict[str, Any]:
    return {
        "id": v.product_id, "product": v.product, "robot": v.robot, "t1_ns": v.t1_ns, "size": v.size,
        "retire": v.retire, "why": v.why,
    }  # fmt: skip

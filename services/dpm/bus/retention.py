# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``dpm/@rpc/retention``: the retention rules of the profile, planned or applied."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from cdff_common.bus import Reply, Request
from cdff_common.contract.names import GROUND
from cdff_common.contract.queries import RetentionParameters
from cdff_common.interfaces.profile import Profile
from dpm_store import RetentionPlan, Rule
from dpm_store.history.events import check_robot
from dpm_store.history.retention import MAX_DECISIONS
from services.dpm.bus.calls import parse_call
from services.dpm.operations.dpm import Dpm


def rules_of(profile: Profile | None) -> tuple[Rule, ...]:
    """Return the retention rules of a profile; none without a profile."""
    return () if profile is None else tuple(Rule(**rule.model_dump()) for rule in profile.retention)


def retention(dpm: Dpm, rules: Sequence[Rule], request: Request) -> Reply | Iterator[Reply]:
    """Return the retention plan: ``{applied, rules, retired, bytes, kept, verdicts}``.

    With ``apply=true`` retired products are deleted and their payloads collected. With ``all=true`` every
    decision is sent, a thousand in a reply, before the final reply with the sums; otherwise the final reply
    has the first thousand.
    """
    parameters = parse_call(RetentionParameters, request)
    if parameters.confirm_clock:
        check_robot(GROUND)
        dpm.writer.clock_guard.confirm()
    if not parameters.all:
        return Reply.of(
            plan_dict(dpm.writer.retire(rules, apply=parameters.apply), len(rules), parameters.apply)
        )
    return _in_parts(dpm, rules, parameters.apply)


def _in_parts(dpm: Dpm, rules: Sequence[Rule], apply: bool) -> Iterator[Reply]:
    decisions = dpm.store.retention.decisions(rules)
    while part := tuple(itertools.islice(decisions, MAX_DECISIONS)):
        yield Reply.of({"verdicts": [asdict(d) for d in part]}, kind="progress", final=False)
    plan = plan_dict(dpm.writer.retire(rules, apply=apply), len(rules), apply)
    yield Reply.of(plan | {"verdicts": []})


def plan_dict(plan: RetentionPlan, rules: int, applied: bool) -> dict[str, Any]:
    """Return a plan with its first decisions in JSON form."""
    return {
        "applied": applied,
        "rules": rules,
        "retired": plan.to_delete,
        "bytes": plan.bytes,
        "kept": plan.to_keep,
        "verdicts": [asdict(d) for d in plan.decisions],
    }

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``dpm/@rpc/retention``: the profile's rules of what may go, planned or applied."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cdff_common.bus import Reply, Request
from cdff_common.errors import InputError
from cdff_common.interfaces.profile import Profile
from dpm_store import Plan, Rule
from services.dpm.operations import Dpm
from services.dpm.parameters import check_names

#: Verdicts in one answer; the sums are of all.
MAX_TOLD = 1000


def rules_of(profile: Profile | None) -> tuple[Rule, ...]:
    """The rules of a profile; without one nothing may go."""
    if profile is None:
        return ()
    return tuple(Rule(r.product, None, r.max_age_s, r.max_bytes) for r in profile.retention)


def retention(dpm: Dpm, rules: Sequence[Rule], request: Request) -> Reply:
    """What may go and why; with ``apply=true`` it is deleted: ``{applied, rules, retired, bytes, verdicts}``."""
    p = request.parameters
    check_names(p, frozenset({"apply", "robot", "request"}))
    wanted = p.get("apply", "false")
    if wanted not in ("true", "false"):
        raise InputError(f"apply={wanted[:20]!r}: expected true or false")
    plan = dpm.retire(rules, apply=wanted == "true")
    return Reply.of({"applied": wanted == "true", "rules": len(rules), **told(plan)})


def told(plan: Plan) -> dict[str, Any]:
    """A plan as plain data."""
    verdicts = [
        {"id": v.product_id, "product": v.product, "robot": v.robot, "t1_ns": v.t1_ns, "size": v.size,
         "retire": v.retire, "why": v.why}
        for v in plan.verdicts[:MAX_TOLD]
    ]  # fmt: skip
    return {"retired": len(plan.retired), "bytes": plan.bytes, "kept": len(plan.verdicts) - len(plan.retired),
            "verdicts": verdicts}  # fmt: skip

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The planner's world, from a profile and descriptions."""

from __future__ import annotations

from typing import Any

import pytest

from cdff_common.interfaces.profile import Profile
from cdff_core.orchestration.catalogue import world_of
from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.reconcile import Observed
from cdff_core.orchestration.world import MakerId

A, B, C, OTHER = (MakerId(*x.split("/")) for x in ("mana/a", "mana/b", "mana/c", "minnie/a"))


def described(maker: MakerId) -> dict[str, Any]:
    return {
        "name": maker.dfpc, "robot": maker.robot, "implementation": "I", "inputs": [], "modes": {},
        "outputs": [{"port": "pose", "product": "pose"}], "cost": {"x": {"cpu_s": 0.1, "memory_mb": 100.0}},
    }  # fmt: skip


@pytest.mark.req("CDFF-SUP-076")
def test_what_runs_or_is_held_has_taken_its_memory_from_its_robot_s_budget() -> None:
    robots = [{"id": "mana", "limits": {"memory_mb": 350.0}}, {"id": "minnie"}]
    profile = Profile.model_validate({"name": "test", "robots": robots})
    leases = Leases()
    leases.acquire("request", [A], {})
    observed = Observed(alive={A, B, C, OTHER}, active={A, B, OTHER})
    world = world_of(profile, {m: described(m) for m in (A, B, C, OTHER)}, observed, leases, {})
    assert world.memory_free_mb == {"mana": 150.0}
    assert world.reserved == {A, B, OTHER}

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The progress of a plan is determined once for each version of the system state."""

from __future__ import annotations

import pytest

from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.plans import Plan
from cdff_core.orchestration.reconciliation import ObservedState
from cdff_core.orchestration.world import ProviderId, SensorId
from services.orchestrator.pending_acquisitions import PendingAcquisitions
from services.orchestrator.plan_progress import LastProgress

MAPPER, LIDAR = ProviderId("mana", "mapper"), SensorId("mana", "lidar")


def mapping() -> Plan:
    return Plan(MAPPER, "dem", (MAPPER,), {LIDAR: "scanning"}, 1.0)


class Observed:
    """Progress with the observations on which it depends."""

    def __init__(self) -> None:
        self.state = ObservedState(alive={MAPPER})
        self.progress = LastProgress(self.state, Leases(), PendingAcquisitions())


@pytest.fixture
def observed() -> Observed:
    return Observed()


def test_a_change_is_seen_with_the_next_version(observed: Observed) -> None:
    plan = mapping()
    waiting = observed.progress.get(plan, "job", 1, {})
    assert waiting.pending == ("mana/lidar", "mana/mapper")
    observed.state.active.add(MAPPER)
    observed.state.modes[LIDAR] = "scanning"
    assert observed.progress.get(plan, "job", 1, {}) is waiting
    assert observed.progress.get(plan, "job", 2, {}).pending == ()


def test_another_plan_of_the_holder_has_its_own_progress(observed: Observed) -> None:
    observed.progress.get(mapping(), "job", 1, {})
    observed.state.active.add(MAPPER)
    assert observed.progress.get(mapping(), "job", 1, {}).inactive == ()


def test_each_holder_has_its_own_progress_until_it_is_removed(observed: Observed) -> None:
    plan = mapping()
    first = observed.progress.get(plan, "job", 1, {})
    observed.state.active.add(MAPPER)
    assert observed.progress.get(plan, "other", 1, {}).inactive == ()
    assert observed.progress.get(plan, "job", 1, {}) is first
    observed.progress.remove("job")
    assert observed.progress.get(plan, "job", 1, {}).inactive == ()


def test_problems_are_replaced_without_a_new_version(observed: Observed) -> None:
    plan, problems = mapping(), {MAPPER: "no input for 3 s"}
    observed.progress.get(plan, "job", 1, {})
    with_problem = observed.progress.get(plan, "job", 1, problems)
    assert with_problem.problems == problems
    assert with_problem.pending == ("mana/lidar", "mana/mapper")
    assert observed.progress.get(plan, "job", 1, {}).problems == {}

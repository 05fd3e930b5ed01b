# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Leases and reconciliation, separately and together in random histories."""

from __future__ import annotations

import random
from typing import get_args

import pytest

from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.reconciliation import (
    BACK_OFF_S,
    Action,
    Activate,
    CleanUp,
    Configure,
    Deactivate,
    ObservedState,
    SetMode,
    dependency_order,
    next_actions,
)
from cdff_core.orchestration.world import ProviderId, SensorId

DEM, POSE, VO = ProviderId("mana", "dem"), ProviderId("mana", "pose"), ProviderId("mana", "vo")
LIDAR = SensorId("mana", "lidar")
UPSTREAM = {DEM: frozenset({POSE}), POSE: frozenset({VO}), VO: frozenset[ProviderId]()}
USES = {DEM: frozenset({LIDAR})}


def test_a_request_takes_providers_of_lower_priority_and_lingering_ones_of_its_own() -> None:
    leases = Leases({DEM: 30.0})
    leases.acquire("low", [DEM, POSE], {}, priority=3)
    leases.acquire("other", [POSE], {}, priority=6)
    assert [leases.takeable(DEM, n) for n in (2, 3, 4)] == [None, None, 3]
    assert [leases.takeable(POSE, n) for n in (6, 7)] == [None, 6]
    assert leases.takeable(VO, 9) is None
    assert leases.without("other").takeable(POSE, 4) == 3
    leases.release("other", 0.0)
    assert leases.takeable(POSE, 4) == 3
    leases.take([DEM, VO], 4)
    assert leases.wanted == {POSE}
    assert leases.taken("low", [DEM, POSE]) == (DEM,)
    assert leases.taken("other", [DEM, POSE]) == ()
    leases.release("low", 1.0)
    leases.acquire("high", [DEM], {}, priority=8)
    leases.release("high", 2.0)
    assert [leases.takeable(DEM, n) for n in (7, 8)] == [None, 8], "lingering keeps the priority"
    leases.take([DEM], 7)
    assert leases.is_wanted(DEM)


@pytest.mark.req("CDFF-SUP-025")
def test_reconciliation_has_actions_for_modes_and_the_life_cycle_of_dfpcs_only() -> None:
    names = {action.__name__ for action in get_args(Action)}
    assert names == {"SetMode", "Acquire", "Configure", "Activate", "Deactivate", "CleanUp"}


def test_a_released_lease_keeps_the_dfpc_active_for_other_holders() -> None:
    leases = Leases()
    leases.acquire("a", [DEM], {})
    leases.acquire("b", [DEM, POSE], {})
    leases.release("a", 0.0)
    assert leases.expire(100.0) == ()
    assert leases.wanted == {DEM, POSE}
    assert leases.holders(DEM) == {"b"}


def test_a_provider_lingers_after_its_last_holder_and_stays_active_for_a_new_one() -> None:
    leases = Leases({DEM: 30.0})
    leases.acquire("a", [DEM], {LIDAR: "on"})
    leases.release("a", 10.0)
    assert [t for _, t in leases.expiries_s] == [40.0]
    assert leases.expire(39.0) == ()
    assert leases.wanted_modes() == {LIDAR: "on"}, "a lingering provider still needs its sensor"
    assert leases.held_mode(LIDAR) is None, "the sensor may change its mode"
    leases.acquire("b", [DEM], {})
    assert leases.expire(100.0) == ()
    leases.release("b", 100.0)
    assert leases.expire(131.0) == (DEM,)
    assert not leases.wanted
    assert leases.wanted_modes() == {}


def test_a_renewed_provider_lingers_longer_with_the_providers_of_its_inputs() -> None:
    leases = Leases({DEM: 30.0, POSE: 20.0, VO: 20.0})
    sources = {DEM: {"poses": "product/pose/pose", "scan": "sensor/lidar/scan"}}
    leases.acquire("a", [DEM, POSE], {LIDAR: "on"}, chosen_sources=sources)
    leases.acquire("b", [VO], {})
    leases.release("a", 0.0)
    leases.renew(DEM, 15.0)
    leases.renew(VO, 15.0)
    assert sorted(t for _, t in leases.expiries_s) == [35.0, 45.0]
    assert leases.holders(VO) == {"b"}, "a held provider does not linger"
    assert leases.expire(40.0) == (POSE,)
    leases.renew(POSE, 41.0)
    assert not leases.is_wanted(POSE), "an expired provider is not started"


def test_modes_are_set_first_then_upstream_providers_are_activated_before_downstream_ones() -> None:
    observed = ObservedState(alive={DEM, POSE, VO}, modes={LIDAR: "off"})
    order = dependency_order([DEM, POSE, VO], UPSTREAM)
    assert order == [VO, POSE, DEM]

    def step() -> list[object]:
        return list(next_actions(order, {LIDAR: "on"}, USES, UPSTREAM, observed, 0.0))

    assert step() == [SetMode(LIDAR, "on"), Activate(VO)]
    observed.modes[LIDAR] = "on"
    observed.active.add(VO)
    assert step() == [Activate(POSE)]
    observed.active.add(POSE)
    assert step() == [Activate(DEM)]
    observed.active.add(DEM)
    assert step() == []


def test_dfpcs_are_deactivated_in_reverse_order_and_only_if_activated_by_this_orchestrator() -> None:
    observed = ObservedState(alive={DEM, POSE, VO}, active={DEM, POSE, VO}, owned={DEM, POSE})
    assert next_actions([], {}, USES, UPSTREAM, observed, 0.0) == [Deactivate(DEM)]
    observed.active.discard(DEM)
    assert next_actions([], {}, USES, UPSTREAM, observed, 0.0) == [Deactivate(POSE)]
    observed.active.discard(POSE)
    assert next_actions([], {}, USES, UPSTREAM, observed, 0.0) == [], (
        "another client activated visual odometry"
    )


def test_a_failed_action_is_repeated_with_growing_pauses_and_does_not_block_downstream_providers() -> None:
    observed = ObservedState(alive={DEM, POSE})
    observed.add_failure(POSE, "the process hangs", 0.0)
    assert next_actions([POSE, DEM], {}, {}, UPSTREAM, observed, 0.1) == [Activate(DEM)]
    assert Activate(POSE) in next_actions([POSE, DEM], {}, {}, UPSTREAM, observed, BACK_OFF_S[0])
    for _ in range(20):
        observed.add_failure(POSE, "the process hangs", 0.0)
    assert observed.failures[POSE].not_before_s == BACK_OFF_S[2]


def test_a_restarted_dfpc_is_activated_again() -> None:
    observed = ObservedState(alive={DEM}, active={DEM}, owned={DEM})
    observed.alive.discard(DEM)
    observed.active.discard(DEM)
    assert next_actions([DEM], {}, {}, {}, observed, 0.0) == []
    observed.alive.add(DEM)
    assert next_actions([DEM], {}, {}, {}, observed, 0.0) == [Activate(DEM)]


def test_in_random_histories_nothing_runs_without_a_lease_and_no_lease_waits_forever() -> None:
    providers = list(UPSTREAM)
    for seed in range(60):
        r = random.Random(seed)
        leases, observed = (
            Leases(dict.fromkeys(providers, 5.0)),
            ObservedState(alive=set(providers), modes={LIDAR: "off"}),
        )
        now_s = 0.0

        def settle(
            r: random.Random = r,
            leases: Leases = leases,
            observed: ObservedState = observed,
            until_s: float = 0.0,
        ) -> None:
            """Execute actions, of which some fail, until there are none."""
            for _ in range(200):
                leases.expire(until_s)
                order = dependency_order(sorted(leases.wanted), UPSTREAM)
                actions = next_actions(order, leases.wanted_modes(), USES, UPSTREAM, observed, until_s)
                if not actions:
                    return
                for action in actions:
                    target = action.sensor if isinstance(action, SetMode) else action.provider
                    if r.random() < 0.2:
                        observed.add_failure(target, "random failure", until_s)
                        continue
                    observed.clear_failures(target)
                    if isinstance(action, SetMode):
                        observed.modes[action.sensor] = action.mode
                    elif isinstance(action, Activate):
                        observed.active.add(action.provider)
                        observed.owned.add(action.provider)
                    else:
                        observed.active.discard(action.provider)
                        observed.owned.discard(action.provider)
            raise AssertionError("reconciliation does not terminate")

        for _ in range(40):
            now_s += r.random() * 4.0
            event = r.random()
            if event < 0.4:
                leases.acquire(
                    r.choice("abc"),
                    r.sample(providers, r.randint(1, 3)),
                    {LIDAR: "on"} if r.random() < 0.5 else {},
                )
            elif event < 0.8:
                leases.release(r.choice("abc"), now_s)
            else:
                dead = r.choice(providers)
                observed.active.discard(dead)
            settle(until_s=now_s)
            if not observed.failures:
                assert observed.active == leases.wanted
        for holder in "abc":
            leases.release(holder, now_s)
        for _ in range(30):
            now_s += 11.0
            settle(until_s=now_s)
        assert not observed.active


@pytest.mark.req("CDFF-SUP-144")
def test_an_unconfigured_or_failed_dfpc_is_configured_before_activation() -> None:
    observed = ObservedState(alive={VO, POSE}, states={VO: "error", POSE: "unconfigured"})
    assert next_actions([VO, POSE], {}, {}, UPSTREAM, observed, 0.0) == [Configure(VO), Configure(POSE)]
    observed.states = {VO: "inactive", POSE: "inactive"}
    assert next_actions([VO, POSE], {}, {}, UPSTREAM, observed, 0.0) == [Activate(VO)]


def test_a_dfpc_in_error_without_lease_is_cleaned_up_if_activated_by_this_orchestrator() -> None:
    observed = ObservedState(alive={VO, POSE}, owned={VO}, states={VO: "error", POSE: "error"})
    assert next_actions([], {}, {}, UPSTREAM, observed, 0.0) == [CleanUp(VO)]


def test_a_provider_waits_until_its_upstream_provider_is_warm() -> None:
    observed = ObservedState(alive={VO, POSE}, active={VO}, warm_at_s={VO: 5.0})
    assert next_actions([VO, POSE], {}, {}, UPSTREAM, observed, 4.9) == []
    assert next_actions([VO, POSE], {}, {}, UPSTREAM, observed, 5.0) == [Activate(POSE)]


def test_mutually_dependent_providers_do_not_wait_forever() -> None:
    observed = ObservedState(alive={VO, POSE})
    upstream = {VO: frozenset({POSE}), POSE: frozenset({VO})}
    assert next_actions(dependency_order([VO, POSE], upstream), {}, {}, upstream, observed, 0.0) != []


def test_a_running_provider_is_rewired_once() -> None:
    observed = ObservedState(
        alive={DEM, POSE}, active={DEM, POSE}, wired={DEM: {"poses": "product/pose/out"}}
    )
    chosen = {DEM: {"poses": "product/slam/out"}}
    assert next_actions([DEM], {}, {}, {}, observed, 0.0, chosen) == [
        Activate(DEM, (("poses", "product/slam/out"),))
    ]
    observed.wired[DEM] = dict(chosen[DEM])
    assert next_actions([DEM], {}, {}, {}, observed, 0.0, chosen) == []


def test_a_lost_sensor_is_neither_commanded_nor_waited_for() -> None:
    observed = ObservedState(alive={DEM}, lost={LIDAR: "no power"})
    assert next_actions([DEM], {LIDAR: "on"}, USES, {}, observed, 0.0) == [Activate(DEM)]


def test_a_lingering_provider_keeps_the_modes_of_the_sensors_that_it_uses() -> None:
    camera, other = SensorId("mana", "camera"), SensorId("minnie", "lidar")
    modes = {LIDAR: "on", camera: "on", other: "on"}
    for uses, kept in (
        (None, {LIDAR, camera}),
        ({DEM: {LIDAR}}, {LIDAR}),
        ({DEM: {LIDAR, other}}, {LIDAR, other}),
    ):
        leases = Leases({DEM: 30.0})
        leases.acquire("a", [DEM], modes, uses=uses)
        assert leases.wanted_modes().keys() == modes.keys()
        leases.release("a", 0.0)
        assert leases.wanted_modes().keys() == kept


def test_without_a_holder_the_mode_is_that_of_the_others() -> None:
    leases = Leases()
    leases.acquire("first", [], {LIDAR: "slow"})
    leases.acquire("urgent", [], {LIDAR: "dense"}, priority=9)
    leases.acquire("alone", [], {SensorId("mana", "camera"): "on"})
    assert leases.without("urgent").wanted_modes() == {LIDAR: "slow", SensorId("mana", "camera"): "on"}
    assert leases.without("alone").wanted_modes() == {LIDAR: "dense"}
    assert leases.wanted_modes()[LIDAR] == "dense"


@pytest.mark.req("CDFF-SUP-145")
def test_the_sensor_mode_is_that_of_the_highest_priority_and_then_of_the_first_request() -> None:
    leases = Leases()
    leases.acquire("first", [], {LIDAR: "slow"})
    leases.acquire("second", [], {LIDAR: "fast"})
    assert leases.wanted_modes() == {LIDAR: "slow"}
    assert leases.displaced("second") == {LIDAR: "slow"}
    leases.acquire("urgent", [], {LIDAR: "dense"}, priority=9)
    assert leases.wanted_modes() == {LIDAR: "dense"}
    assert set(leases.displaced("first")) == set(leases.displaced("second")) == {LIDAR}
    leases.release("urgent", 0.0)
    assert leases.wanted_modes() == {LIDAR: "slow"}


def test_a_mode_that_satisfies_all_leases_is_preferred() -> None:
    leases = Leases()
    leases.acquire("a", [], {LIDAR: "slow"}, accepts={LIDAR: ["slow", "dense"]})
    leases.acquire("b", [], {LIDAR: "fast"}, accepts={LIDAR: ["fast", "dense"]})
    assert leases.wanted_modes() == {LIDAR: "dense"}
    assert not leases.displaced("a")
    assert not leases.displaced("b")

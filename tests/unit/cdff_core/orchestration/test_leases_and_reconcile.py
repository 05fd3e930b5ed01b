# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Leases and the reconciliation that follows them, alone and together over random histories."""

from __future__ import annotations

import random
from typing import get_args

import pytest

from cdff_core.orchestration.leases import Leases
from cdff_core.orchestration.reconcile import (
    BACK_OFF_S,
    Action,
    Activate,
    CleanUp,
    Configure,
    Deactivate,
    Observed,
    SetMode,
    dependency_order,
    next_actions,
)
from cdff_core.orchestration.world import MakerId, SensorId

DEM, POSE, VO = MakerId("mana", "dem"), MakerId("mana", "pose"), MakerId("mana", "vo")
LIDAR = SensorId("mana", "lidar")
FEEDS = {DEM: frozenset({POSE}), POSE: frozenset({VO}), VO: frozenset[MakerId]()}
USES = {DEM: frozenset({LIDAR})}


@pytest.mark.req("CDFF-SUP-025")
def test_all_it_ever_does_to_a_dfpc_is_to_switch_it_on_and_off() -> None:
    verbs = {a.__name__ for a in get_args(Action)}
    assert verbs == {"SetMode", "Configure", "Activate", "Deactivate", "CleanUp"}


def test_what_one_holder_lets_go_stays_on_for_another() -> None:
    leases = Leases()
    leases.acquire("a", [DEM], {})
    leases.acquire("b", [DEM, POSE], {})
    leases.release("a", 0.0)
    assert leases.expire(100.0) == ()
    assert leases.wanted == {DEM, POSE}
    assert leases.holders(DEM) == {"b"}


def test_a_maker_lingers_after_its_last_holder_and_a_new_one_keeps_it_on() -> None:
    leases = Leases({DEM: 30.0})
    leases.acquire("a", [DEM], {LIDAR: "on"})
    leases.release("a", 10.0)
    assert leases.next_expiry_s() == 40.0
    assert leases.expire(39.0) == ()
    assert leases.wanted_modes() == {LIDAR: "on"}, "a lingering maker still lives on its sensor"
    assert leases.held_mode(LIDAR) is None, "but nobody keeps the sensor from changing"
    leases.acquire("b", [DEM], {})
    assert leases.expire(100.0) == ()
    leases.release("b", 100.0)
    assert leases.expire(131.0) == (DEM,)
    assert not leases.wanted
    assert leases.wanted_modes() == {}


def test_modes_come_first_then_feeders_then_those_they_feed() -> None:
    observed = Observed(alive={DEM, POSE, VO}, modes={LIDAR: "off"})
    order = dependency_order([DEM, POSE, VO], FEEDS)
    assert order == [VO, POSE, DEM]

    def step() -> list[object]:
        return list(next_actions(order, {LIDAR: "on"}, USES, FEEDS, observed, 0.0))

    assert step() == [SetMode(LIDAR, "on"), Activate(VO)]
    observed.modes[LIDAR] = "on"
    observed.active.add(VO)
    assert step() == [Activate(POSE)]
    observed.active.add(POSE)
    assert step() == [Activate(DEM)]
    observed.active.add(DEM)
    assert step() == []


def test_what_is_switched_off_goes_in_the_opposite_order_and_only_if_it_is_ours() -> None:
    observed = Observed(alive={DEM, POSE, VO}, active={DEM, POSE, VO}, owned={DEM, POSE})
    assert next_actions([], {}, USES, FEEDS, observed, 0.0) == [Deactivate(DEM)]
    observed.active.discard(DEM)
    assert next_actions([], {}, USES, FEEDS, observed, 0.0) == [Deactivate(POSE)]
    observed.active.discard(POSE)
    assert next_actions([], {}, USES, FEEDS, observed, 0.0) == [], "somebody else activated visual odometry"


def test_a_failure_is_tried_again_after_a_growing_pause_and_does_not_hold_up_what_it_feeds() -> None:
    observed = Observed(alive={DEM, POSE})
    observed.attempt(POSE).failed("it hangs", 0.0)
    assert next_actions([POSE, DEM], {}, {}, FEEDS, observed, 0.1) == [Activate(DEM)]
    assert Activate(POSE) in next_actions([POSE, DEM], {}, {}, FEEDS, observed, BACK_OFF_S[0])
    for _ in range(20):
        observed.attempt(POSE).failed("it hangs", 0.0)
    assert observed.attempt(POSE).not_before_s == BACK_OFF_S[2]


def test_a_dfpc_that_died_and_came_back_is_activated_again() -> None:
    observed = Observed(alive={DEM}, active={DEM}, owned={DEM})
    observed.alive.discard(DEM)
    observed.active.discard(DEM)
    assert next_actions([DEM], {}, {}, {}, observed, 0.0) == []
    observed.alive.add(DEM)
    assert next_actions([DEM], {}, {}, {}, observed, 0.0) == [Activate(DEM)]


def test_over_random_histories_nothing_runs_without_a_holder_and_no_holder_waits_for_ever() -> None:
    makers = list(FEEDS)
    for seed in range(60):
        r = random.Random(seed)
        leases, observed = Leases(dict.fromkeys(makers, 5.0)), Observed(alive=set(makers), modes={LIDAR: "off"})
        now_s = 0.0

        def settle(
            r: random.Random = r, leases: Leases = leases, observed: Observed = observed, until_s: float = 0.0
        ) -> None:
            """Carry actions out, some of which fail, until there are none."""
            for _ in range(200):
                leases.expire(until_s)
                order = dependency_order(sorted(leases.wanted), FEEDS)
                actions = next_actions(order, leases.wanted_modes(), USES, FEEDS, observed, until_s)
                if not actions:
                    return
                for action in actions:
                    what = action.sensor if isinstance(action, SetMode) else action.maker
                    if r.random() < 0.2:
                        observed.attempt(what).failed("bad luck", until_s)
                        continue
                    observed.succeeded(what)
                    if isinstance(action, SetMode):
                        observed.modes[action.sensor] = action.mode
                    elif isinstance(action, Activate):
                        observed.active.add(action.maker)
                        observed.owned.add(action.maker)
                    else:
                        observed.active.discard(action.maker)
                        observed.owned.discard(action.maker)
            raise AssertionError("the loop does not come to rest")

        for _ in range(40):
            now_s += r.random() * 4.0
            event = r.random()
            if event < 0.4:
                leases.acquire(
                    r.choice("abc"), r.sample(makers, r.randint(1, 3)), {LIDAR: "on"} if r.random() < 0.5 else {}
                )
            elif event < 0.8:
                leases.release(r.choice("abc"), now_s)
            else:
                dead = r.choice(makers)
                observed.active.discard(dead)
            settle(until_s=now_s)
            if not observed.attempts:
                assert observed.active == leases.wanted
        for holder in "abc":
            leases.release(holder, now_s)
        for _ in range(30):
            now_s += 11.0
            settle(until_s=now_s)
        assert not observed.active


@pytest.mark.req("CDFF-SUP-144")
def test_what_is_not_configured_or_in_error_is_configured_before_it_is_activated() -> None:
    observed = Observed(alive={VO, POSE}, states={VO: "error", POSE: "unconfigured"})
    assert next_actions([VO, POSE], {}, {}, FEEDS, observed, 0.0) == [Configure(VO), Configure(POSE)]
    observed.states = {VO: "inactive", POSE: "inactive"}
    assert next_actions([VO, POSE], {}, {}, FEEDS, observed, 0.0) == [Activate(VO)]


def test_what_is_in_error_and_wanted_by_nobody_is_cleaned_up_if_it_is_ours() -> None:
    observed = Observed(alive={VO, POSE}, owned={VO}, states={VO: "error", POSE: "error"})
    assert next_actions([], {}, {}, FEEDS, observed, 0.0) == [CleanUp(VO)]


def test_what_a_feeder_feeds_waits_until_it_is_warm() -> None:
    observed = Observed(alive={VO, POSE}, active={VO}, warm_at_s={VO: 5.0})
    assert next_actions([VO, POSE], {}, {}, FEEDS, observed, 4.9) == []
    assert next_actions([VO, POSE], {}, {}, FEEDS, observed, 5.0) == [Activate(POSE)]


def test_makers_that_feed_each_other_do_not_wait_for_each_other_for_ever() -> None:
    observed = Observed(alive={VO, POSE})
    feeds = {VO: frozenset({POSE}), POSE: frozenset({VO})}
    assert next_actions(dependency_order([VO, POSE], feeds), {}, {}, feeds, observed, 0.0) != []


def test_a_running_maker_is_told_to_take_its_input_from_elsewhere_once() -> None:
    observed = Observed(alive={DEM, POSE}, active={DEM, POSE}, wired={DEM: {"poses": "product/pose/out"}})
    chosen = {DEM: {"poses": "product/slam/out"}}
    assert next_actions([DEM], {}, {}, {}, observed, 0.0, chosen) == [
        Activate(DEM, (("poses", "product/slam/out"),))
    ]  # fmt: skip
    observed.wired[DEM] = dict(chosen[DEM])
    assert next_actions([DEM], {}, {}, {}, observed, 0.0, chosen) == []


def test_a_lost_sensor_is_neither_set_nor_waited_for() -> None:
    observed = Observed(alive={DEM}, lost={LIDAR: "no power"})
    assert next_actions([DEM], {LIDAR: "on"}, USES, {}, observed, 0.0) == [Activate(DEM)]


@pytest.mark.req("CDFF-SUP-145")
def test_the_higher_priority_has_the_sensor_and_equals_in_the_order_they_came() -> None:
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


def test_a_mode_that_serves_all_holders_is_taken_over_the_one_each_planned() -> None:
    leases = Leases()
    leases.acquire("a", [], {LIDAR: "slow"}, accepts={LIDAR: ["slow", "dense"]})
    leases.acquire("b", [], {LIDAR: "fast"}, accepts={LIDAR: ["fast", "dense"]})
    assert leases.wanted_modes() == {LIDAR: "dense"}
    assert not leases.displaced("a")
    assert not leases.displaced("b")

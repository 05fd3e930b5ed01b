# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transition tables of jobs, DFPCs and sensor modes, and recovery from a journal."""

from __future__ import annotations

import pytest

from cdff_common.errors import (
    ConflictError,
    DeniedError,
    NotActiveError,
    ProductNotFoundError,
    UnavailableError,
)
from cdff_common.interfaces.sensor_profile import Sensor, SensorMode
from cdff_core.orchestration.journal import recover
from cdff_core.orchestration.lifecycle import (
    DFPC_TRANSITIONS,
    FINAL_STATES,
    JOB_TRANSITIONS,
    JobState,
    next_job_state,
)
from cdff_core.orchestration.modes import MODE_TRANSITIONS, ModeMachine
from cdff_core.orchestration.world import ProviderId

NAVCAM = Sensor(
    kind="stereo_camera",
    frame="mana/navcam_left",
    streams={"pair": "FramePair"},
    initial_mode="off",
    switch_s=0.5,
    modes={"off": SensorMode(on=False), "nominal": SensorMode(rate_hz=3.0), "fast": SensorMode(rate_hz=9.0)},
    refuses=("fast",),
)


def test_every_open_job_can_fail_or_be_cancelled_and_every_job_state_can_be_reached() -> None:
    for state in JobState:
        if state not in FINAL_STATES:
            assert {JobState.FAILED, JobState.CANCELLED} <= JOB_TRANSITIONS[state]
    reached, stack = set(), [JobState.RECEIVED]
    while stack:
        state = stack.pop()
        if state not in reached:
            reached.add(state)
            stack.extend(JOB_TRANSITIONS[state])
    assert reached == set(JobState)


def test_a_job_in_a_final_state_cannot_change_its_state() -> None:
    for state in FINAL_STATES:
        with pytest.raises(ConflictError):
            next_job_state(state, JobState.LOOKING)


def test_hosts_follow_the_dfpc_table_and_every_state_can_be_entered_and_left() -> None:
    from services.dfpc_host.lifecycle import DfpcState, next_state

    for (state, verb), to in DFPC_TRANSITIONS.items():
        assert next_state(verb, DfpcState(state), "x") == to
    with pytest.raises(NotActiveError, match="allowed when active or inactive"):
        next_state("activate", DfpcState.ERROR, "x")
    reached, stack = set(), ["unconfigured"]
    while stack:
        state = stack.pop()
        if state not in reached:
            reached.add(state)
            stack.extend(to for (a, _), to in DFPC_TRANSITIONS.items() if a == state)
    assert reached == {str(s) for s in DfpcState}
    assert all("unconfigured" in _following(str(s)) or s is DfpcState.ACTIVE for s in DfpcState)


def _following(state: str) -> set[str]:
    return {to for (a, _), to in DFPC_TRANSITIONS.items() if a == state}


def test_a_mode_is_confirmed_only_after_the_switch() -> None:
    machine = ModeMachine("navcam", NAVCAM)
    assert machine.demand("nominal", "orchestrator", 10.0)
    assert machine.mode == "off"
    assert not machine.settle(10.4)
    assert machine.settle(10.5)
    assert (machine.mode, machine.state) == ("nominal", "steady")
    event = machine.event()
    assert (event["sensor"], event["mode"], event["on"], event["rate_hz"]) == ("navcam", "nominal", True, 3.0)
    assert (event["state"], event["reason"]) == ("steady", "")


def test_a_sensor_begins_in_its_last_confirmed_mode_or_in_its_initial_mode() -> None:
    assert ModeMachine("navcam", NAVCAM).mode == NAVCAM.initial_mode == "off"
    assert ModeMachine("navcam", NAVCAM, mode="nominal").mode == "nominal"


def test_requesting_the_current_mode_changes_nothing() -> None:
    machine = ModeMachine("navcam", NAVCAM)
    assert not machine.demand("off", "", 0.0)
    assert machine.state == "steady"


def test_a_repeated_demand_does_not_delay_a_switch_and_a_new_demand_replaces_it() -> None:
    machine = ModeMachine("navcam", NAVCAM)
    machine.demand("nominal", "", 0.0)
    machine.demand("nominal", "", 0.4)
    assert machine.steps[-1][1] == 0.5
    machine.demand("off", "", 0.4)
    assert (machine.target, machine.steps[-1][1]) == ("off", 0.9)


def test_refused_and_unknown_modes_leave_the_sensor_unchanged() -> None:
    machine = ModeMachine("navcam", NAVCAM)
    with pytest.raises(DeniedError, match="refuses"):
        machine.demand("fast", "", 0.0)
    with pytest.raises(ProductNotFoundError, match="nominal"):
        machine.demand("x_ray", "", 0.0)
    assert (machine.mode, machine.target) == ("off", None)
    assert {state for state, _ in MODE_TRANSITIONS} == {"steady", "switching", "lost"}


GIMBALLED = Sensor(
    kind="lidar",
    frame="mana/lidar",
    streams={"scan": "LidarScan"},
    initial_mode="off",
    modes={"off": SensorMode(on=False), "warm": SensorMode(on=False), "scan": SensorMode(rate_hz=2.0)},
    transitions={"off": {"warm": 4.0}, "warm": {"scan": 1.0, "off": 0.5}, "scan": {"warm": 0.5}},
)


@pytest.mark.req("CDFF-SUP-143")
def test_a_mode_without_direct_transition_is_reached_over_intermediate_modes() -> None:
    machine = ModeMachine("lidar", GIMBALLED)
    assert machine.demand("scan", "", 0.0)
    assert machine.steps[-1][1] == 5.0
    assert not machine.settle(3.9)
    assert machine.settle(4.5)
    assert (machine.mode, machine.target, machine.state) == ("warm", "scan", "switching")
    assert machine.settle(5.0)
    assert (machine.mode, machine.state) == ("scan", "steady")
    assert GIMBALLED.mode_path("scan", "off") == (("warm", 0.5), ("off", 0.5))


def test_an_unreachable_mode_is_denied() -> None:
    one_way = GIMBALLED.model_copy(update={"transitions": {"off": {"warm": 1.0}, "warm": {}}})
    with pytest.raises(DeniedError, match="cannot switch from mode off to scan"):
        ModeMachine("lidar", one_way).demand("scan", "", 0.0)


def test_a_lost_sensor_refuses_demands_until_it_has_recovered_in_its_initial_mode() -> None:
    machine = ModeMachine("lidar", GIMBALLED)
    machine.demand("warm", "", 0.0)
    machine.fail("no power")
    assert (machine.state, machine.event()["on"], machine.event()["reason"]) == ("lost", False, "no power")
    with pytest.raises(UnavailableError, match="lost: no power"):
        machine.demand("warm", "", 1.0)
    machine.recover()
    assert (machine.state, machine.mode) == ("steady", "off")


def test_a_sensor_that_refuses_during_a_switch_keeps_the_last_confirmed_mode() -> None:
    machine = ModeMachine("lidar", GIMBALLED)
    machine.demand("scan", "", 0.0)
    machine.settle(4.0)
    machine.refuse("too hot")
    assert (machine.mode, machine.state, machine.refusal) == ("warm", "steady", "too hot")


def test_every_sensor_event_is_in_the_transition_table() -> None:
    machine = ModeMachine("lidar", GIMBALLED)
    actions = {
        "demand": lambda: machine.demand("scan", "", 0.0),
        "refuse": lambda: machine.refuse("no"),
        "fail": lambda: machine.fail("gone"),
        "recover": machine.recover,
        "pass": lambda: machine.settle(1e9),
        "confirm": lambda: machine.settle(1e9),
    }
    verbs = ["demand", "refuse", "demand", "demand", "pass", "confirm", "fail", "recover", "demand", "fail"]
    for verb in verbs:
        previous_state = machine.state
        actions[verb]()
        assert MODE_TRANSITIONS[previous_state, verb] == machine.state, verb
    assert {verb for _, verb in MODE_TRANSITIONS} == set(verbs)


def test_a_journal_restores_open_jobs_leases_and_activations() -> None:
    dem, pose = ProviderId("mana", "dem"), ProviderId("mana", "pose")
    result = recover(
        [
            {"kind": "start"},
            {"kind": "job", "job": "1", "state": "received"},
            {"kind": "job", "job": "2", "state": "received"},
            {"kind": "lease", "action": "acquire", "holder": "1", "providers": ["mana/dem", "mana/pose"]},
            {"kind": "lease", "action": "acquire", "holder": "2", "providers": ["mana/pose"]},
            {"kind": "activation", "action": "activate", "dfpc": "mana/dem", "ok": True},
            {"kind": "activation", "action": "activate", "dfpc": "mana/pose", "ok": True},
            {"kind": "activation", "action": "deactivate", "dfpc": "mana/pose", "ok": False},
            {"kind": "something newer"},
            {"kind": "mode", "sensor": "mana/lidar", "mode": "nominal", "ok": True},
            {"kind": "job", "job": "1", "state": "done"},
            {"kind": "lease", "action": "release", "holder": "1"},
            {"kind": "activation", "action": "deactivate", "dfpc": "mana/dem", "ok": True},
        ]
    )
    assert set(result.open_jobs) == {"2"}
    assert result.held == {pose}
    assert result.owned == {pose}
    assert result.jobs == 2
    assert dem not in result.owned
    recovered_again = recover(result.records())
    assert (set(recovered_again.open_jobs), recovered_again.owned, recovered_again.modes) == (
        set(result.open_jobs),
        result.owned,
        result.modes,
    )

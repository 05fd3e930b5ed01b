# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""State machines that are data: jobs, DFPCs, sensor modes; and what a journal leads to."""

from __future__ import annotations

import pytest

from cdff_common.errors import ConflictError, DeniedError, NotActiveError, ProductNotFoundError, UnavailableError
from cdff_common.interfaces.profile import Sensor, SensorMode
from cdff_core.orchestration.journal import recover
from cdff_core.orchestration.lifecycle import DFPC_TRANSITIONS, FINAL_STATES, JOB_TRANSITIONS, JobState, next_job_state
from cdff_core.orchestration.modes import MODE_TRANSITIONS, ModeMachine
from cdff_core.orchestration.world import MakerId

NAVCAM = Sensor(
    kind="stereo_camera", frame="mana/navcam_left", streams={"pair": "FramePair"}, initial_mode="off", switch_s=0.5,
    modes={"off": SensorMode(on=False), "nominal": SensorMode(rate_hz=3.0), "fast": SensorMode(rate_hz=9.0)},
    refuses=("fast",),
)  # fmt: skip


def test_every_job_can_fail_be_cancelled_and_reach_an_end() -> None:
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


def test_a_job_that_ended_stays_ended() -> None:
    for state in FINAL_STATES:
        with pytest.raises(ConflictError):
            next_job_state(state, JobState.LOOKING)


def test_hosts_run_the_dfpc_table_and_every_state_can_be_left_and_reached() -> None:
    from services.dfpc_host.lifecycle import State, next_state

    for (state, verb), to in DFPC_TRANSITIONS.items():
        assert next_state(verb, State(state), "x") == to
    with pytest.raises(NotActiveError, match="allowed when active or inactive"):
        next_state("activate", State.ERROR, "x")
    reached, stack = set(), ["unconfigured"]
    while stack:
        state = stack.pop()
        if state not in reached:
            reached.add(state)
            stack.extend(to for (a, _), to in DFPC_TRANSITIONS.items() if a == state)
    assert reached == {str(s) for s in State}
    assert all(("unconfigured" in _following(str(s))) or s is State.ACTIVE for s in State)


def _following(state: str) -> set[str]:
    return {to for (a, _), to in DFPC_TRANSITIONS.items() if a == state}


def test_a_mode_is_confirmed_only_when_the_switch_is_over() -> None:
    machine = ModeMachine("navcam", NAVCAM)
    assert machine.demand("nominal", "orchestrator", 10.0)
    assert machine.mode == "off"
    assert not machine.settle(10.4)
    assert machine.settle(10.5)
    assert (machine.mode, machine.state) == ("nominal", "steady")
    event = machine.event()
    assert (event["sensor"], event["mode"], event["on"], event["rate_hz"]) == ("navcam", "nominal", True, 3.0)
    assert (event["state"], event["reason"]) == ("steady", "")


def test_asking_for_the_mode_it_is_in_changes_nothing() -> None:
    machine = ModeMachine("navcam", NAVCAM)
    assert not machine.demand("off", "", 0.0)
    assert machine.state == "steady"


def test_asking_again_does_not_delay_a_switch_and_asking_otherwise_redirects_it() -> None:
    machine = ModeMachine("navcam", NAVCAM)
    machine.demand("nominal", "", 0.0)
    machine.demand("nominal", "", 0.4)
    assert machine.ready_at_s == 0.5
    machine.demand("off", "", 0.4)
    assert (machine.target, machine.ready_at_s) == ("off", 0.9)


def test_refused_and_unknown_modes_leave_the_sensor_as_it_is() -> None:
    machine = ModeMachine("navcam", NAVCAM)
    with pytest.raises(DeniedError, match="refuses"):
        machine.demand("fast", "", 0.0)
    with pytest.raises(ProductNotFoundError, match="nominal"):
        machine.demand("x_ray", "", 0.0)
    assert (machine.mode, machine.target) == ("off", None)
    assert {state for state, _ in MODE_TRANSITIONS} == {"steady", "switching", "lost"}


GIMBALLED = Sensor(
    kind="lidar", frame="mana/lidar", streams={"scan": "LidarScan"}, initial_mode="off",
    modes={"off": SensorMode(on=False), "warm": SensorMode(on=False), "scan": SensorMode(rate_hz=2.0)},
    transitions={"off": {"warm": 4.0}, "warm": {"scan": 1.0, "off": 0.5}, "scan": {"warm": 0.5}},
)  # fmt: skip


@pytest.mark.req("CDFF-SUP-143")
def test_a_mode_without_a_direct_way_is_reached_over_those_the_profile_declares_in_between() -> None:
    machine = ModeMachine("lidar", GIMBALLED)
    assert machine.demand("scan", "", 0.0)
    assert machine.ready_at_s == 5.0
    assert not machine.settle(3.9)
    assert machine.settle(4.5)
    assert (machine.mode, machine.target, machine.state) == ("warm", "scan", "switching")
    assert machine.settle(5.0)
    assert (machine.mode, machine.state) == ("scan", "steady")
    assert GIMBALLED.way("scan", "off") == (("warm", 0.5), ("off", 0.5))


def test_a_mode_without_any_way_is_denied() -> None:
    one_way = GIMBALLED.model_copy(update={"transitions": {"off": {"warm": 1.0}, "warm": {}}})
    with pytest.raises(DeniedError, match="no way from mode off to scan"):
        ModeMachine("lidar", one_way).demand("scan", "", 0.0)


def test_a_lost_sensor_takes_no_demand_until_it_is_back_in_its_initial_mode() -> None:
    machine = ModeMachine("lidar", GIMBALLED)
    machine.demand("warm", "", 0.0)
    machine.fail("no power")
    assert (machine.state, machine.event()["on"], machine.event()["reason"]) == ("lost", False, "no power")
    with pytest.raises(UnavailableError, match="lost: no power"):
        machine.demand("warm", "", 1.0)
    machine.recover()
    assert (machine.state, machine.mode) == ("steady", "off")


def test_a_switch_refused_on_its_way_stays_at_the_last_confirmed_mode() -> None:
    machine = ModeMachine("lidar", GIMBALLED)
    machine.demand("scan", "", 0.0)
    machine.settle(4.0)
    machine.refuse("too hot")
    assert (machine.mode, machine.state, machine.refusal) == ("warm", "steady", "too hot")


def test_every_thing_that_happens_to_a_sensor_is_in_the_table() -> None:
    machine = ModeMachine("lidar", GIMBALLED)
    happens = {
        "demand": lambda: machine.demand("scan", "", 0.0), "refuse": lambda: machine.refuse("no"),
        "fail": lambda: machine.fail("gone"), "recover": machine.recover,
        "pass": lambda: machine.settle(1e9), "confirm": lambda: machine.settle(1e9),
    }  # fmt: skip
    verbs = ["demand", "refuse", "demand", "demand", "pass", "confirm", "fail", "recover", "demand", "fail"]
    for verb in verbs:
        before = machine.state
        happens[verb]()
        assert MODE_TRANSITIONS[before, verb] == machine.state, verb
    assert {verb for _, verb in MODE_TRANSITIONS} == set(verbs)


def test_a_journal_tells_which_jobs_were_open_and_what_was_held_and_switched_on() -> None:
    dem, pose = MakerId("mana", "dem"), MakerId("mana", "pose")
    found = recover(
        [
            {"kind": "start"},
            {"kind": "job", "job": "1", "state": "received"},
            {"kind": "job", "job": "2", "state": "received"},
            {"kind": "lease", "action": "acquire", "holder": "1", "makers": ["mana/dem", "mana/pose"]},
            {"kind": "lease", "action": "acquire", "holder": "2", "makers": ["mana/pose"]},
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
    assert set(found.open_jobs) == {"2"}
    assert found.held == {pose}
    assert found.owned == {pose}
    assert found.jobs == 2
    assert dem not in found.owned
    again = recover(found.records())
    assert (set(again.open_jobs), again.owned, again.modes) == (set(found.open_jobs), found.owned, found.modes)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""State machines that are data: jobs, DFPCs, sensor modes; and what a journal leads to."""

from __future__ import annotations

import pytest

from cdff_common.errors import ConflictError, DeniedError, ProductNotFoundError
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


def test_the_dfpc_table_is_the_one_that_hosts_run() -> None:
    from services.dfpc_host.lifecycle import TRANSITIONS

    hosts = {(str(state), verb): str(to) for (verb, state), to in TRANSITIONS.items()}
    for edge, to in hosts.items():
        assert DFPC_TRANSITIONS[edge] == to


def test_a_mode_is_confirmed_only_when_the_switch_is_over() -> None:
    machine = ModeMachine("navcam", NAVCAM)
    assert machine.demand("nominal", "orchestrator", 10.0)
    assert machine.mode == "off"
    assert not machine.settle(10.4)
    assert machine.settle(10.5)
    assert (machine.mode, machine.state) == ("nominal", "steady")
    assert machine.event() == {"sensor": "navcam", "mode": "nominal", "on": True, "rate_hz": 3.0}


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
    assert {state for state, _ in MODE_TRANSITIONS} == {"steady", "switching"}


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

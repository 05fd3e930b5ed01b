# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mutated requests, answers of the instrument control unit, and heartbeats: each request has exactly one
final reply or refusal, and afterwards the service works as before.

The service runs in virtual time on the simulated mission.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from cdff_common.bus import Message, Reply, keys
from cdff_common.bus.message import pack
from cdff_common.errors import CdffError, InputError
from cdff_common.interfaces.registry import Registry
from cdff_core.orchestration.lifecycle import FINAL_STATES
from cdff_core.orchestration.world import ProviderId
from tests.support import orchestrator_mission
from tests.support.orchestrator_stage import DEM, Stage, provider_of

#: Mutations of each kind in a test run, and in the long run.
FEW, MANY = 300, 10_000
REQUESTS: tuple[Mapping[str, str], ...] = (
    {**DEM, "region": "bbox:0,0,4,4", "resolution_m": "1.0", "min_coverage": "0.1", "deadline_ms": "3000"},
    {"type": "pose", "robot": "mana", "max_age_s": "5", "max_sigma_m": "0.5", "deadline_ms": "2000"},
    {"type": "navigation_map", "robot": "any", "region": "circle:0,0,3", "deadline_ms": "1000"},
    {"type": "dem", "robot": "minnie", "every_s": "0.5", "deadline_ms": "3000", "priority": "7"},
    {"type": "pose", "robot": "any", "frame": "site", "child": "mana/base", "explain": "true"},
)
TEXTS = (
    "", " ", "0", "-1", "1e400", "nan", "inf", "-0.0", "9" * 40, "true", "null", "None", "mana", "site",
    "a/b/c",
    "bbox:0,0", "bbox:0,0,1e308,1e308", "polygon:0,0,1,1", "circle:0,0,-1", "near:mana/base,1", "near:x,1",
    "2026-01-01T00:00:00Z", "é" * 300, "x" * 5000, "\x00", "uper", "tif", "any", "ground", "calibrated",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 2**63 - 1, 1.5, float("nan"), float("inf"), "", "x" * 1000, "on", "lost", "error",
    "active", "inactive", b"\xff\x00", [], [1, [2, [3]]], {}, {"mode": 1}, {"state": None}, {1: 2},
)  # fmt: skip


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Stage:
    monkeypatch.setattr(
        Registry, "default", classmethod(lambda cls: orchestrator_mission.SimulatedRegistry())
    )
    return Stage(tmp_path)


def mutated_request(r: random.Random) -> dict[str, str]:
    """Return a request with one to three fields removed, replaced, exchanged or added."""
    request = dict(r.choice(REQUESTS))
    for _ in range(r.randint(1, 3)):
        name = r.choice(list(request) or ["type"])
        change = r.random()
        if change < 0.2:
            request.pop(name, None)
        elif change < 0.7:
            request[name] = r.choice(TEXTS)
        elif change < 0.85:
            other = r.choice(list(request) or ["type"])
            request[name], request[other] = request.get(other, ""), request.get(name, "")
        else:
            request[r.choice((*request, *TEXTS[:6], "nosuch", "t", "as", "format", "deliver"))] = r.choice(
                TEXTS
            )
    if len(request.get("deadline_ms", "")) > 5:  # no request waits for hours of virtual time
        request["deadline_ms"] = "500"
    return request


def mutated_body(r: random.Random, body: Mapping[str, Any]) -> Any:
    """Return a body with one to three fields, at any depth, removed or replaced; or a value instead of it."""
    if r.random() < 0.1:
        return r.choice(VALUES)
    mutated = dict(body)
    for _ in range(r.randint(1, 3)):
        name = r.choice(list(mutated) or ["state"])
        value, change = mutated.get(name), r.random()
        if isinstance(value, dict) and change < 0.5:
            mutated[name] = mutated_body(r, value)
        elif change < 0.2:
            mutated.pop(name, None)
        else:
            mutated[name] = r.choice(VALUES)
    return mutated


def assert_works(stage: Stage) -> None:
    """Assert that no loop has ended, no request is open, and a request is served."""
    stage.mission.mode_answers.clear()
    stage.mission.modes_answer = None
    for process in stage.mission.processes.values():  # repairs what the mutated heartbeats stated
        stage.mission.publish_status(process)
    stage.run(60.0)
    assert stage.orchestrator.loops.problem() == ""
    states = {job["state"] for job in stage.call("jobs", limit="200")["jobs"]}
    assert states <= {str(state) for state in FINAL_STATES}
    assert provider_of(stage.final_answer(stage.send(**DEM))) in ("dem", "stereo_dem")


def check_requests(stage: Stage, count: int) -> Counter[str]:
    """Send mutated requests, eight at a time; return the number of each outcome."""
    r, outcomes = random.Random(7), Counter[str]()
    for _ in range(0, count, 8):
        batch = [stage.send(**mutated_request(r)) for _ in range(8)]
        for received in batch:
            stage.final_answer(received, 120.0)
            finals = [x for x in received[:-1] if isinstance(x, CdffError) or x.attachment.get("final")]
            assert len(finals) == 1, received
            assert finals[0] is received[-2]
            final = finals[0]
            outcomes[final.attachment["kind"] if isinstance(final, Reply) else type(final).__name__] += 1
    return outcomes


def check_unit_answers(stage: Stage, count: int) -> Counter[str]:
    """Send requests while the instrument control unit answers with mutated bodies; count the outcomes."""
    r, outcomes = random.Random(8), Counter[str]()
    modes = stage.mission.icu.modes("mana")
    event = {"robot": "mana", "confirmed": True, **next(iter(modes["sensors"].values()))}
    for _ in range(count):
        stage.mission.mode_answers = {
            mode: mutated_body(r, {**event, "mode": mode})
            for mode in ("slow", "fast", "dense", "warm", "nominal")
        }
        stage.mission.modes_answer = mutated_body(r, modes)
        # The unit reappears: its modes are queried.
        stage.mission.token(keys.alive("mana", "icu"), present=False)
        stage.mission.token(keys.alive("mana", "icu"), present=True)
        received = stage.send(**{**DEM, "deadline_ms": "1000"})
        final = stage.final_answer(received)
        outcomes[final.attachment["kind"] if isinstance(final, Reply) else type(final).__name__] += 1
    return outcomes


def check_heartbeats(stage: Stage, count: int) -> Counter[str]:
    """Publish mutated statuses, events and descriptions; messages that are no map are refused and counted."""
    r, outcomes = random.Random(9), Counter[str]()
    process = stage.process("dem")
    status = stage.mission._status(process)
    event = {"sensor": "lidar", "mode": "slow", "state": "steady", "on": True, "reason": ""}
    subjects: tuple[tuple[str, Mapping[str, Any]], ...] = (
        (keys.dfpc_status(*ProviderId("mana", "dem")), status),
        (keys.event("mana", "sensor_mode"), event),
        (keys.event("mana", "inserted"), {"product": "dem", "id": "x"}),
        (keys.event("mana", "alarm"), {"dfpc": "dem", "state": "error", "reason": "simulated"}),
    )
    for _ in range(count):
        key, body = r.choice(subjects)
        payload = pack(mutated_body(r, body))
        if r.random() < 0.1:
            payload = payload[: r.randrange(len(payload) + 1)]
        for pattern, callback in stage.bus._subscriptions:
            parts = key.split("/")
            if len(pattern) == len(parts) and all(a in ("*", b) for a, b in zip(pattern, parts, strict=True)):
                callback(Message(key, payload, "", b""))
        outcomes["published"] += 1
        if not outcomes["published"] % 50:
            stage.run(1.0)
    return outcomes


CHECKS: tuple[Callable[[Stage, int], Counter[str]], ...] = (
    check_requests,
    check_unit_answers,
    check_heartbeats,
)


@pytest.mark.parametrize("check", CHECKS)
@pytest.mark.parametrize(
    "count", [FEW, pytest.param(MANY, marks=[pytest.mark.soak, pytest.mark.timeout(3600)])]
)
def test_mutated_input_has_one_answer_each_and_stops_nothing(
    stage: Stage, check: Callable[[Stage, int], Counter[str]], count: int
) -> None:
    outcomes = check(stage, count)
    assert sum(outcomes.values()) >= count
    if check is check_requests:
        assert outcomes[InputError.__name__] > count // 4
        assert outcomes["product"] + outcomes["end"] > 0
    assert_works(stage)

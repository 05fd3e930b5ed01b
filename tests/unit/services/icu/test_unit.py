# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The simulated Instrument Control Unit: modes are confirmed, refused or superseded."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

import pytest

from cdff_common.clock import monotonic_s
from cdff_common.errors import ConflictError, DeniedError, InputError, ProductNotFoundError, UnavailableError
from cdff_common.interfaces.profile import Profile, Robot
from cdff_common.interfaces.sensor_profile import Sensor, SensorMode
from services.icu.unit import Faults, SimulatedIcu


def simulated_icu(
    switch_s: float,
    events: list[tuple[str, Mapping[str, object]]],
    faults: Faults | None = None,
    clock: Callable[[], float] = monotonic_s,
) -> SimulatedIcu:
    lidar = Sensor(
        kind="lidar",
        frame="mana/lidar",
        streams={"scan": "LidarScan"},
        initial_mode="off",
        switch_s=switch_s,
        modes={
            "off": SensorMode(on=False),
            "nominal": SensorMode(rate_hz=2.0),
            "fast": SensorMode(rate_hz=9.0),
        },
        refuses=("fast",),
    )
    profile = Profile(name="p", robots=(Robot(id="mana", sensors={"lidar": lidar}),))
    return SimulatedIcu(profile, lambda *event: events.append(event), faults, clock)


@pytest.mark.req("CDFF-SUP-022")
def test_a_mode_call_is_answered_and_reported_once_the_mode_is_reached() -> None:
    received: list[tuple[str, Mapping[str, object]]] = []
    icu = simulated_icu(0.02, received)
    answer = icu.set_mode("mana", "lidar", "nominal", "client")
    event = {
        "sensor": "lidar",
        "mode": "nominal",
        "state": "steady",
        "on": True,
        "rate_hz": 2.0,
        "width_px": None,
        "height_px": None,
        "stereo": None,
        "exposure": None,
        "reason": "",
    }
    assert answer == {"robot": "mana", "confirmed": True, **event}
    assert received == [("mana", event)]
    assert icu.modes("mana")["sensors"]["lidar"]["holder"] == "client"
    icu.set_mode("mana", "lidar", "nominal", "client")
    assert len(received) == 1, "a demand for the present mode is not an event"


def test_a_refused_or_unknown_mode_changes_nothing() -> None:
    received: list[tuple[str, Mapping[str, object]]] = []
    icu = simulated_icu(0.0, received)
    with pytest.raises(DeniedError):
        icu.set_mode("mana", "lidar", "fast", "client")
    for robot, sensor, mode in (("mana", "lidar", "x"), ("mana", "sonar", "off"), ("minnie", "lidar", "off")):
        with pytest.raises(ProductNotFoundError):
            icu.set_mode(robot, sensor, mode, "client")
    with pytest.raises(ProductNotFoundError):
        icu.modes("minnie")
    assert received == []
    assert icu.modes("mana")["sensors"]["lidar"]["mode"] == "off"


def test_a_waiting_call_superseded_by_another_demand_is_refused() -> None:
    icu = simulated_icu(30.0, [])
    raised: list[BaseException] = []
    waiting = threading.Thread(target=lambda: raised.append(error_of_mode_call(icu, "nominal")))
    waiting.start()
    while icu.modes("mana")["sensors"]["lidar"]["target"] != "nominal":
        assert waiting.is_alive()
    superseding = threading.Thread(target=lambda: raised.append(error_of_mode_call(icu, "off")))
    superseding.start()
    waiting.join(5)
    assert isinstance(raised[0], ConflictError)
    icu.close()
    superseding.join(5)
    assert isinstance(raised[1], UnavailableError)


@pytest.mark.req("CDFF-SUP-143")
def test_delays_and_refusals_depend_on_the_seed_and_are_marked_as_simulated() -> None:
    def session(seed: int) -> list[object]:
        now_s = [0.0]
        icu = simulated_icu(1.0, [], Faults(seed=seed, spread=0.3, refuses=0.3), lambda: now_s[0])
        assert icu.modes("mana")["simulated"] is True
        outcomes: list[object] = []
        for i in range(40):
            machine = icu.demand("mana", "lidar", "nominal" if i % 2 else "off", "client").machine
            outcomes.append(round(machine.steps[-1][1] - now_s[0], 6) if machine.steps else 0.0)
            now_s[0] += 10.0
            icu.modes("mana")
            outcomes.append(machine.refusal)
        return outcomes

    first = session(1)
    assert first == session(1)
    assert first != session(2)
    assert any(isinstance(x, str) and "simulated refusal" in x for x in first)
    assert len({x for x in first if isinstance(x, float) and x > 0}) > 10


def test_a_lost_sensor_is_reported_ends_the_wait_and_recovers_in_its_initial_mode() -> None:
    received: list[tuple[str, Mapping[str, object]]] = []
    icu = simulated_icu(30.0, received)
    raised: list[BaseException] = []
    waiting = threading.Thread(target=lambda: raised.append(error_of_mode_call(icu, "nominal")))
    waiting.start()
    while icu.modes("mana")["sensors"]["lidar"]["target"] != "nominal":
        assert waiting.is_alive()
    icu.lose("mana", "lidar", "no power")
    waiting.join(5)
    assert "no power" in str(raised[0])
    icu.recover("mana", "lidar")
    assert [(e["state"], e["mode"], e["reason"]) for _, e in received] == [
        ("lost", "off", "no power"),
        ("steady", "off", ""),
    ]


@pytest.mark.parametrize("text", ["refuses=2", "spread=-1", "colour=3", "seed=x"])
def test_invalid_faults_are_refused(text: str) -> None:
    assert Faults.of_text("seed=3,spread=0.2,refuses=0.1") == Faults(seed=3, spread=0.2, refuses=0.1)
    with pytest.raises(InputError):
        Faults.of_text(text)


def error_of_mode_call(icu: SimulatedIcu, mode: str) -> BaseException:
    try:
        icu.set_mode("mana", "lidar", mode, "client")
    except (ConflictError, UnavailableError) as error:
        return error
    raise AssertionError("the mode was confirmed")

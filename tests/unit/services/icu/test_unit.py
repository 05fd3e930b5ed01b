# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The simulated Instrument Control Unit: modes are confirmed, refused, redirected."""

from __future__ import annotations

import threading
from collections.abc import Mapping

import pytest

from cdff_common.errors import ConflictError, DeniedError, ProductNotFoundError, UnavailableError
from cdff_common.interfaces.profile import Profile, Robot, Sensor, SensorMode
from services.icu.unit import SimulatedIcu


def unit(switch_s: float, told: list[tuple[str, Mapping[str, object]]]) -> SimulatedIcu:
    lidar = Sensor(
        kind="lidar", frame="mana/lidar", streams={"scan": "LidarScan"}, initial_mode="off", switch_s=switch_s,
        modes={"off": SensorMode(on=False), "nominal": SensorMode(rate_hz=2.0), "fast": SensorMode(rate_hz=9.0)},
        refuses=("fast",),
    )  # fmt: skip
    return SimulatedIcu(
        Profile(name="p", robots=(Robot(id="mana", sensors={"lidar": lidar}),)), lambda *event: told.append(event)
    )


@pytest.mark.req("CDFF-SUP-022")
def test_a_mode_is_answered_and_told_once_it_is_reached() -> None:
    told: list[tuple[str, Mapping[str, object]]] = []
    icu = unit(0.02, told)
    answer = icu.set_mode("mana", "lidar", "nominal", "me")
    assert answer == {
        "robot": "mana", "confirmed": True, "sensor": "lidar", "mode": "nominal", "on": True, "rate_hz": 2.0,
    }  # fmt: skip
    assert told == [("mana", {"sensor": "lidar", "mode": "nominal", "on": True, "rate_hz": 2.0})]
    assert icu.modes("mana")["sensors"]["lidar"]["holder"] == "me"
    icu.set_mode("mana", "lidar", "nominal", "me")
    assert len(told) == 1, "the mode it is in is no change"


def test_a_refused_or_unknown_mode_changes_nothing() -> None:
    told: list[tuple[str, Mapping[str, object]]] = []
    icu = unit(0.0, told)
    with pytest.raises(DeniedError):
        icu.set_mode("mana", "lidar", "fast", "me")
    for robot, sensor, mode in (("mana", "lidar", "x"), ("mana", "sonar", "off"), ("minnie", "lidar", "off")):
        with pytest.raises(ProductNotFoundError):
            icu.set_mode(robot, sensor, mode, "me")
    with pytest.raises(ProductNotFoundError):
        icu.modes("minnie")
    assert told == []
    assert icu.modes("mana")["sensors"]["lidar"]["mode"] == "off"


def test_who_is_overtaken_by_another_demand_is_told_so() -> None:
    icu = unit(30.0, [])
    raised: list[BaseException] = []
    waiting = threading.Thread(target=lambda: raised.append(_raised(icu, "nominal")))
    waiting.start()
    while icu.modes("mana")["sensors"]["lidar"]["target"] != "nominal":
        assert waiting.is_alive()
    second = threading.Thread(target=lambda: raised.append(_raised(icu, "off")))
    second.start()
    waiting.join(5)
    assert isinstance(raised[0], ConflictError)
    icu.close()
    second.join(5)
    assert isinstance(raised[1], UnavailableError)


def _raised(icu: SimulatedIcu, mode: str) -> BaseException:
    try:
        icu.set_mode("mana", "lidar", mode, "me")
    except (ConflictError, UnavailableError) as error:
        return error
    raise AssertionError("it was confirmed")

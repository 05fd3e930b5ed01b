# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A recorded sensor obeys the Instrument Control Unit."""

from __future__ import annotations

import pytest

from cdff_common.errors import InputError
from cdff_dev.play.gate import SensorGate

S = 1_000_000_000


def delivered(gate: SensorGate, stamps_ns: list[int]) -> list[int]:
    return [t for t in stamps_ns if gate.passes("mana", "navcam", "pair", t)]


def test_a_sensor_nobody_spoke_of_is_on() -> None:
    gate = SensorGate()
    assert gate.is_on("mana", "imu")
    assert delivered(gate, [0, 1, 2]) == [0, 1, 2]


def test_a_sensor_that_is_off_delivers_nothing_until_it_is_on_again() -> None:
    gate = SensorGate()
    gate.set("mana", "navcam", {"on": False, "rate_hz": None})
    assert delivered(gate, [0, S]) == []
    gate.set("mana", "navcam", {"on": True, "rate_hz": None})
    assert delivered(gate, [2 * S, 3 * S]) == [2 * S, 3 * S]


def test_a_mode_of_another_robot_or_sensor_does_not_matter() -> None:
    gate = SensorGate()
    gate.set("minnie", "navcam", {"on": False, "rate_hz": None})
    gate.set("mana", "lidar", {"on": False, "rate_hz": None})
    assert delivered(gate, [0, S]) == [0, S]


def test_a_rate_at_that_of_the_recording_loses_nothing_to_rounded_stamps() -> None:
    gate = SensorGate()
    gate.set("mana", "navcam", {"on": True, "rate_hz": 3.0})
    stamps = [round(k / 3 * 1e6) * 1000 for k in range(30)]
    assert delivered(gate, stamps) == stamps


def test_a_lower_rate_thins_the_recording_and_is_never_exceeded() -> None:
    gate = SensorGate()
    gate.set("mana", "navcam", {"on": True, "rate_hz": 1.0})
    stamps = [round(k / 3 * 1e6) * 1000 for k in range(31)]
    assert delivered(gate, stamps) == stamps[::3]


def test_a_rate_of_zero_is_off() -> None:
    gate = SensorGate()
    gate.set("mana", "navcam", {"on": True, "rate_hz": 0.0})
    assert not gate.is_on("mana", "navcam")
    assert delivered(gate, [0, S]) == []


@pytest.mark.parametrize("body", [{}, {"on": 1}, {"on": True, "rate_hz": "3"}])
def test_a_malformed_mode_is_refused_and_changes_nothing(body: dict[str, object]) -> None:
    gate = SensorGate()
    with pytest.raises(InputError, match="mana/navcam"):
        gate.set("mana", "navcam", body)
    assert gate.is_on("mana", "navcam")

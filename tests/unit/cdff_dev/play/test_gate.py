# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gate passes recorded samples according to the sensor modes of the ICU."""

from __future__ import annotations

import pytest

from cdff_common.errors import InputError
from cdff_dev.play.gate import SensorGate

S = 1_000_000_000


def passed_stamps(gate: SensorGate, stamps_ns: list[int]) -> list[int]:
    return [t for t in stamps_ns if gate.passes("mana", "navcam", "pair", t)]


def test_a_sensor_without_mode_event_is_on() -> None:
    gate = SensorGate()
    assert gate.is_on("mana", "imu")
    assert passed_stamps(gate, [0, 1, 2]) == [0, 1, 2]


def test_a_sensor_that_is_off_delivers_nothing() -> None:
    gate = SensorGate()
    gate.set("mana", "navcam", {"on": False, "rate_hz": None})
    assert passed_stamps(gate, [0, S]) == []
    gate.set("mana", "navcam", {"on": True, "rate_hz": None})
    assert passed_stamps(gate, [2 * S, 3 * S]) == [2 * S, 3 * S]


def test_modes_of_other_robots_and_sensors_have_no_effect() -> None:
    gate = SensorGate()
    gate.set("minnie", "navcam", {"on": False, "rate_hz": None})
    gate.set("mana", "lidar", {"on": False, "rate_hz": None})
    assert passed_stamps(gate, [0, S]) == [0, S]


def test_the_recorded_rate_drops_no_sample_by_rounding() -> None:
    gate = SensorGate()
    gate.set("mana", "navcam", {"on": True, "rate_hz": 3.0})
    stamps = [round(k / 3 * 1e6) * 1000 for k in range(30)]
    assert passed_stamps(gate, stamps) == stamps


def test_a_lower_rate_decimates_the_recording_and_is_never_exceeded() -> None:
    gate = SensorGate()
    gate.set("mana", "navcam", {"on": True, "rate_hz": 1.0})
    stamps = [round(k / 3 * 1e6) * 1000 for k in range(31)]
    assert passed_stamps(gate, stamps) == stamps[::3]


def test_a_rate_of_zero_is_off() -> None:
    gate = SensorGate()
    gate.set("mana", "navcam", {"on": True, "rate_hz": 0.0})
    assert not gate.is_on("mana", "navcam")
    assert passed_stamps(gate, [0, S]) == []


@pytest.mark.parametrize("body", [{}, {"on": 1}, {"on": True, "rate_hz": "3"}])
def test_a_malformed_mode_is_refused_and_changes_nothing(body: dict[str, object]) -> None:
    gate = SensorGate()
    with pytest.raises(InputError, match="mana/navcam"):
        gate.set("mana", "navcam", body)
    assert gate.is_on("mana", "navcam")

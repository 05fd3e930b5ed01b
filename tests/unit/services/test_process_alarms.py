# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alarms that every process can raise: memory, calibration."""

from __future__ import annotations

import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.product import Quality
from cdff_core.consistency.finding import Finding
from services import memory_budget
from services.alarms import Alarms
from services.dfpc_host.calibration_alarms import PRODUCTS, CalibrationMonitor, set_calibration_alarm
from services.dfpc_host.sensor_alarms import SensorAlarms
from services.memory_budget import memory_budget_mb, memory_check


def test_memory_over_the_budget_raises_an_alarm_until_it_is_below(monkeypatch: pytest.MonkeyPatch) -> None:
    alarms = Alarms()
    memory_check(alarms, "dpm", 1)()
    (alarm,) = alarms.active()
    assert (alarm.kind, alarm.source) == ("memory_over_budget", "dpm")
    assert "at most 1 MB" in alarm.what
    memory_check(alarms, "dpm", 100_000)()
    assert alarms.active() == []


def test_a_process_that_has_grown_returns_freed_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    resident = iter((100.0, 90.0, 110.0, 130.0, 95.0, 120.0))
    released = []
    monkeypatch.setattr(memory_budget, "resident_mb", lambda: next(resident))
    monkeypatch.setattr(memory_budget, "release_memory", lambda: released.append(True))
    check, counts = memory_check(Alarms(), "dpm", 2000), []
    for _ in range(4):
        check()
        counts.append(len(released))
    assert counts == [1, 1, 2, 2]


def test_a_malformed_budget_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CDFF_MEMORY_MB", "much")
    with pytest.raises(ConfigurationError, match="CDFF_MEMORY_MB='much'"):
        memory_budget_mb()
    monkeypatch.setenv("CDFF_MEMORY_MB", "300")
    assert memory_budget_mb() == 300


@pytest.mark.parametrize(
    "reason", ["row_offset:2.10>1.00", "camera_roll:0.10>0.06", "mount_error:lidar_odometry_2.10_deg"]
)
def test_data_that_lastingly_contradict_the_calibration_raise_an_alarm_and_single_ones_do_not(
    reason: str,
) -> None:
    alarms, monitor = Alarms(), CalibrationMonitor()
    good = Quality()
    other, bad = Quality.from_reasons(["few_inliers:3<5"]), Quality.from_reasons([reason])
    monitor.add([bad] * (PRODUCTS - 1) + [good] + [bad] * (PRODUCTS - 1))
    set_calibration_alarm(alarms, "mana/vo", monitor)
    assert alarms.active() == []
    monitor.add([bad])
    set_calibration_alarm(alarms, "mana/vo", monitor)
    (alarm,) = alarms.active()
    assert (alarm.kind, alarm.source) == ("calibration_drift", "mana/vo")
    assert reason in alarm.what
    monitor.add([other] * PRODUCTS)
    set_calibration_alarm(alarms, "mana/vo", monitor)
    assert alarms.active() == []


@pytest.mark.parametrize("kind", ["sensor_rotation", "sensor_clock", "sensor_samples", "sensor_frame"])
def test_a_sensor_that_disagrees_with_the_others_is_an_alarm_until_it_agrees(kind: str) -> None:
    alarms = Alarms()
    sensor_alarms = SensorAlarms(alarms, "mana", "digital_elevation_mapping")
    what = "expected rpy_deg [180.0, 0.0, 0.0], observed [0.0, 0.0, 0.0]"
    sensor_alarms.update([Finding(kind, ("lidar",), "180_deg", what, "correct the mount")])
    (alarm,) = alarms.active()
    assert (alarm.kind, alarm.source) == (kind, "mana/lidar")
    assert what in alarm.what
    assert "digital_elevation_mapping" in alarm.what
    sensor_alarms.update([])
    assert alarms.active() == []

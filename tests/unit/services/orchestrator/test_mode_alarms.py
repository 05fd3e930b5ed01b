# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Alarms of the instrument control unit begin with a failed demand and end by confirmation or time."""

from __future__ import annotations

import pytest

from cdff_common.errors import (
    CdffError,
    CodecError,
    DeadlineError,
    DeniedError,
    NoAnswerError,
    UnavailableError,
)
from cdff_core.orchestration.world import SensorId
from services.alarms import Alarms
from services.orchestrator.mode_alarms import QUIET_S, START_S, ModeAlarms
from services.orchestrator.timing import Timing

LIDAR = SensorId("mana", "lidar")


class ManualTiming(Timing):
    """Timing whose seconds are set by tests."""

    seconds = 0.0

    def now_s(self) -> float:
        return self.seconds


@pytest.mark.parametrize(
    ("error", "kinds"),
    [
        (DeniedError("too hot"), ["mode_refused"]),
        (CodecError("confirmed: False"), ["mode_unconfirmed"]),
        (DeadlineError("no answer"), ["unit_silent"]),
        (NoAnswerError("no unit"), ["unit_silent"]),
        (UnavailableError("the sensor is lost"), []),
    ],
)
def test_each_failure_has_its_alarm(error: CdffError, kinds: list[str]) -> None:
    alarms, timing = Alarms(), ManualTiming()
    mode_alarms = ModeAlarms(alarms, timing)
    timing.seconds = START_S
    mode_alarms.report(LIDAR, "slow", error)
    assert [alarm.kind for alarm in alarms.active()] == kinds
    mode_alarms.confirm(LIDAR, "fast")
    assert [alarm.kind for alarm in alarms.active()] == kinds
    mode_alarms.confirm(LIDAR, "slow")
    assert alarms.active() == []


def test_an_alarm_ends_if_the_mode_is_not_demanded_again() -> None:
    alarms, timing = Alarms(), ManualTiming()
    mode_alarms = ModeAlarms(alarms, timing)
    mode_alarms.report(LIDAR, "slow", DeniedError("too hot"))
    timing.seconds = QUIET_S - 1.0
    mode_alarms.update()
    assert len(alarms.active()) == 1
    timing.seconds = QUIET_S + 1.0
    mode_alarms.update()
    assert alarms.active() == []


def test_a_unit_that_starts_after_the_orchestrator_is_no_alarm() -> None:
    alarms, timing = Alarms(), ManualTiming()
    mode_alarms = ModeAlarms(alarms, timing)
    mode_alarms.report(LIDAR, "slow", NoAnswerError("no unit"))
    assert alarms.active() == []
    mode_alarms.report(LIDAR, "slow", DeadlineError("no answer"))
    assert [alarm.kind for alarm in alarms.active()] == ["unit_silent"]

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Problems of DFPCs: silent sensors, failed outputs, processes that are gone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cdff_common.interfaces.profile import load_profile
from cdff_core.orchestration.reconciliation import ObservedState
from cdff_core.orchestration.world import ProviderId, SensorId
from services.orchestrator.provider_monitor import GONE_S, MAX_FAILED_OUTPUTS, SILENT_S, ProviderMonitor

PROFILE = load_profile(Path(__file__).parents[4] / "deploy" / "profiles" / "rover_traverse.yaml")
VO = ProviderId("mana", "visual_odometry_sparse")
NAVCAM = SensorId("mana", "navcam")
#: Ports: a mandatory camera, optional wheels, and poses that are no sensor.
INPUTS = [
    {"port": "stereo", "source": "sensor/navcam/pair", "optional": False},
    {"port": "odometry", "source": "sensor/wheels/odometry", "optional": True},
    {"port": "poses", "source": "product/position_manager/pose", "optional": False},
]


@pytest.fixture
def observed() -> ObservedState:
    return ObservedState()


@pytest.fixture
def monitor(observed: ObservedState) -> ProviderMonitor:
    return ProviderMonitor(PROFILE, observed, {VO: {"inputs": INPUTS}})


def status(stereo: int, odometry: int = 0, outputs: int = 0, failed: int = 0) -> dict[str, Any]:
    counts = {"stereo": stereo, "odometry": odometry}
    return {"samples_by_port": counts, "outputs": outputs, "failed": failed}


def test_a_mandatory_sensor_without_samples_is_a_problem_after_the_limit(monitor: ProviderMonitor) -> None:
    monitor.set_active(VO, 10.0)
    assert not monitor.add_status(VO, status(5, 5), 11.0)
    assert not monitor.add_status(VO, status(5, 9), 11.0 + SILENT_S)
    assert monitor.problems([VO], 11.0 + SILENT_S) == {}
    problem = monitor.problems([VO], 11.1 + SILENT_S)
    assert problem == {VO: f"no sample of {NAVCAM} reaches {VO}"}
    monitor.add_status(VO, status(6, 9), 12.0 + SILENT_S)
    assert monitor.problems([VO], 12.1 + SILENT_S) == {}


def test_an_optional_sensor_may_be_silent_if_another_one_is_not(monitor: ProviderMonitor) -> None:
    monitor.set_active(VO, 10.0)
    for second in range(11, 30):
        monitor.add_status(VO, status(second, 5), float(second))
    assert monitor.problems([VO], 30.0) == {}
    assert "navcam" in monitor.problems([VO], 40.0)[VO]


def test_a_slow_sensor_is_silent_after_three_periods(
    monitor: ProviderMonitor, observed: ObservedState
) -> None:
    sensor = PROFILE.robot("mana").sensors["navcam"]
    slow = sensor.modes["slow"].model_copy(update={"rate_hz": 0.25})
    modes = sensor.modes | {"slow": slow}
    robots = [
        robot.model_copy(
            update={"sensors": robot.sensors | {"navcam": sensor.model_copy(update={"modes": modes})}}
        )
        for robot in PROFILE.robots
    ]
    observed.modes[NAVCAM] = "slow"
    descriptions = {VO: {"inputs": INPUTS[:1]}}
    of_slow = ProviderMonitor(PROFILE.model_copy(update={"robots": robots}), observed, descriptions)
    of_slow.set_active(VO, 0.0)
    of_slow.add_status(VO, status(1), 0.0)
    assert of_slow.problems([VO], 12.0) == {}
    assert of_slow.problems([VO], 12.1) != {}


def test_a_port_wired_to_a_product_needs_no_sensor(monitor: ProviderMonitor, observed: ObservedState) -> None:
    observed.wired[VO] = {"stereo": "product/other/pair", "odometry": "product/other/pose"}
    monitor.set_active(VO, 0.0)
    monitor.add_status(VO, status(1), 0.0)
    assert monitor.problems([VO], 100.0) == {}


def test_failed_outputs_in_a_row_are_a_problem_until_a_good_one(monitor: ProviderMonitor) -> None:
    monitor.set_active(VO, 0.0)
    monitor.add_status(VO, status(1, outputs=3, failed=2), 0.0)
    failed = 2 + MAX_FAILED_OUTPUTS
    assert not monitor.add_status(VO, status(2, outputs=failed, failed=failed - 1), 1.0)
    assert monitor.problems([VO], 1.0) == {}
    assert monitor.add_status(VO, status(3, outputs=failed + 1, failed=failed), 2.0)
    assert monitor.problems([VO], 2.0) == {VO: f"the last {MAX_FAILED_OUTPUTS} outputs of {VO} failed"}
    assert monitor.add_status(VO, status(4, outputs=failed + 2, failed=failed), 3.0)
    assert monitor.problems([VO], 3.0) == {}


def test_a_process_is_gone_after_the_limit_since_it_disappeared(monitor: ProviderMonitor) -> None:
    monitor.set_alive(VO, False, 10.0)
    monitor.set_alive(VO, False, 12.0)
    assert monitor.problems([VO], 10.0 + GONE_S) == {}
    assert monitor.problems([VO], 10.1 + GONE_S) == {VO: f"the process of {VO} is gone"}
    monitor.set_alive(VO, True, 14.0)
    assert monitor.problems([VO], 20.0) == {}


def test_an_activation_starts_without_problems(monitor: ProviderMonitor) -> None:
    assert monitor.set_active(VO, 1.0) == 0.0
    assert monitor.set_active(VO, 4.0) == 3.0
    monitor.add_status(VO, status(1), 4.0)
    monitor.set_inactive(VO)
    assert not monitor.add_status(VO, status(1), 50.0)
    assert monitor.problems([VO], 50.0) == {}
    assert monitor.set_active(VO, 60.0) == 0.0
    assert monitor.problems([VO], 100.0) == {}

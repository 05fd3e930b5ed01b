# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Single acquisitions: parameters, mode machine, gate of recorded sensors, and plans."""

from __future__ import annotations

from dataclasses import replace

import pytest

from cdff_common.contract.acquisition import AcquisitionParameters
from cdff_common.errors import ConflictError, InputError
from cdff_common.interfaces.sensor_profile import Sensor
from cdff_core.orchestration.acquisition import acquisitions_of
from cdff_core.orchestration.modes import ModeMachine
from cdff_core.orchestration.planner import Plan, plan
from cdff_core.orchestration.request import parse_request
from cdff_dev.play.gate import SensorGate
from tests.support.planner_worlds import from_sensor, provider, sensor, world

PAN = {"least": -90, "greatest": 90, "speed_per_s": 30}
CAMERA = Sensor.model_validate(
    {
        "kind": "camera",
        "frame": "mana/mast",
        "streams": {"image": "Frame"},
        "modes": {
            "off": {"on": False},
            "video": {"rate_hz": 5, "power_w": 6},
            "shot": {"acquires": 2, "acquire_s": 0.5, "power_w": 10, "parameters": {"pan_deg": PAN}},
        },
        "initial_mode": "off",
        "switch_s": 1.0,
    }
)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("now", {}),
        ("pan_deg:30", {"pan_deg": 30.0}),
        ("tilt_deg:-1.5e1,pan_deg:0.1", {"pan_deg": 0.1, "tilt_deg": -15.0}),
    ],
)
def test_the_parameters_of_an_acquisition_are_read_and_written(text: str, values: dict[str, float]) -> None:
    parameters = AcquisitionParameters.parse(text)
    assert parameters.to_dict() == values
    assert AcquisitionParameters.parse(str(parameters)) == parameters == AcquisitionParameters.of(values)


@pytest.mark.parametrize(
    "text", ["", "pan_deg", "pan_deg:", "pan:nan", "pan:1e999", "a:1,a:2", "a:1,", "a:1;b:2"]
)
def test_malformed_parameters_are_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"acquire=.*expected now, or NAME:NUMBER"):
        AcquisitionParameters.parse(text)


def test_an_acquisition_moves_acquires_and_returns_to_the_previous_mode() -> None:
    machine = ModeMachine("mast", CAMERA)
    assert machine.demand("shot", "job", 0.0, parameters={"pan_deg": 60.0})
    assert machine.is_acquiring
    with pytest.raises(ConflictError, match="acquires for job"):
        machine.demand("video", "other", 0.5)
    assert machine.next_s() == 1.0
    assert machine.settle(1.0)
    assert (machine.mode, machine.acquisitions) == ("shot", 1)
    event = machine.event()
    assert (event["acquires"], event["acquisition"], event["parameters"]) == (2, 1, {"pan_deg": 60.0})
    assert machine.next_s() == 1.0 + 0.5 + 2.0, "half a second, and 60 degrees at 30 degrees per second"
    assert not machine.settle(3.4)
    assert machine.settle(3.5)
    assert (machine.mode, machine.is_acquiring, machine.next_s()) == ("off", False, None)
    machine.demand("shot", "job", 10.0, parameters={"pan_deg": 60.0})
    machine.settle(11.0)
    assert machine.next_s() == 11.5, "it points there already"
    acquisition = machine.acquisition
    machine.fail("cable")
    assert (machine.state, machine.next_s()) == ("lost", None)
    assert acquisition is not None
    assert not acquisition.is_done
    machine.recover()
    assert not machine.is_acquiring


@pytest.mark.parametrize(
    ("mode", "parameters", "fault"),
    [
        ("shot", {"pan_deg": 120.0}, "pan_deg=120: expected -90 to 90"),
        ("shot", {"zoom": 2.0}, "no parameter zoom; it has pan_deg"),
        ("video", {"pan_deg": 1.0}, "not for single acquisitions"),
    ],
)
def test_parameters_that_a_mode_does_not_have_are_refused(
    mode: str, parameters: dict[str, float], fault: str
) -> None:
    with pytest.raises(InputError, match=fault):
        ModeMachine("mast", CAMERA).demand(mode, "job", 0.0, parameters=parameters)


def test_the_gate_passes_the_samples_of_an_acquisition_once() -> None:
    gate = SensorGate()
    machine = ModeMachine("mast", CAMERA)
    for start_s in (0.0, 10.0):
        machine.demand("shot", "job", start_s)
        machine.settle(start_s + 1.0)
        gate.set("mana", "mast", machine.event())
        assert [gate.passes("mana", "mast", "image", i) for i in range(4)] == [True, True, False, False]
        machine.settle(start_s + 9.0)
        gate.set("mana", "mast", machine.event())
        assert not gate.passes("mana", "mast", "image", 5)


def test_duration_and_energy_include_the_motion() -> None:
    turned = acquisitions_of(CAMERA, AcquisitionParameters.of({"pan_deg": -90.0}), {"pan_deg": 90.0})
    assert turned["shot"].describe() == {
        "mode": "shot",
        "parameters": {"pan_deg": -90.0},
        "duration_s": 6.5,
        "energy_j": 65.0,
    }
    assert acquisitions_of(CAMERA, AcquisitionParameters.of({"pan_deg": 91.0}), {}) == {}


def test_a_plan_of_an_acquisition_states_mode_time_and_energy() -> None:
    acquisitions = acquisitions_of(CAMERA, AcquisitionParameters.of({"pan_deg": 30.0}), {})
    mast = sensor(
        "mast", modes={"off": False, "video": False, "shot": True}, switch_s={"off": 0.0, "shot": 1.0}
    )
    seeing = world(
        provider("dem", "dem", from_sensor("image", "mast")), replace(mast, acquisitions=acquisitions)
    )
    planned = plan(seeing, "dem", ["mana"])
    assert isinstance(planned, Plan)
    assert planned.describe()["acquisitions"] == {
        "mana/mast": {"mode": "shot", "parameters": {"pan_deg": 30.0}, "duration_s": 1.5, "energy_j": 15.0}
    }
    assert planned.ready_s == 1.0 + 1.5


def test_an_acquisition_is_neither_standing_nor_for_another_time() -> None:
    assert parse_request({"type": "dem", "acquire": "pan_deg:3"}, "mana").acquire is not None
    for other in ({"every_s": "1"}, {"t": "1000"}):
        with pytest.raises(InputError, match="acquire=now: not together with"):
            parse_request({"type": "dem", "acquire": "now", **other}, "mana")

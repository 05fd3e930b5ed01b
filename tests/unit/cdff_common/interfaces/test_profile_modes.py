# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensor modes and wiring of a profile: required modes, mode transitions, and refusals with the reason."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.sensor_profile import ModeNeed, Sensor, SensorMode

NAVCAM: dict[str, Any] = {
    "kind": "stereo_camera",
    "frame": "mana/navcam_left",
    "streams": {"pair": "FramePair"},
    "initial_mode": "off",
    "modes": {
        "off": {"on": False},
        "slow": {"rate_hz": 1.0, "stereo": True, "width_px": 1024, "height_px": 768, "exposure": "auto"},
        "fast": {"rate_hz": 10.0, "stereo": True, "width_px": 512, "height_px": 384, "exposure": "short"},
        "mono": {"rate_hz": 10.0, "stereo": False, "width_px": 1024, "height_px": 768, "exposure": "auto"},
        "bare": {},
    },
    "switch_s": 0.5,
}


def robot(**entry: Any) -> Profile:
    dfpc = {"name": "visual_odometry_sparse", "inputs": {"stereo": "sensor/navcam/pair"}, **entry}
    robots = [{"id": "mana", "sensors": {"navcam": NAVCAM}, "dfpcs": [dfpc, {"name": "other", "inputs": {}}]}]
    return Profile.model_validate({"name": "p", "robots": robots})


@pytest.mark.req("CDFF-SUP-143")
@pytest.mark.parametrize(
    ("requirement", "modes"),
    [
        ("slow", "slow"),
        ("fast|slow", "fast|slow"),
        ({"stereo": True}, "slow|fast"),
        ({"min_rate_hz": 5.0}, "fast|mono"),
        ({"max_rate_hz": 5.0}, "slow"),
        ({"min_width_px": 800, "min_height_px": 700}, "slow|mono"),
        ({"exposure": ["short", "long"]}, "fast"),
        ({}, "slow|fast|mono|bare"),
    ],
)
def test_a_requirement_of_a_dfpc_selects_the_modes_that_satisfy_it(requirement: Any, modes: str) -> None:
    mana = robot(modes={"navcam": requirement}).robot("mana")
    assert mana.modes_of(mana.dfpcs[0]) == {"navcam": modes}


@pytest.mark.parametrize("requirement", ["x_ray", "slow|x_ray", {"min_rate_hz": 99.0}])
def test_a_requirement_that_no_mode_satisfies_is_refused(requirement: Any) -> None:
    with pytest.raises(ValidationError, match="which no sensor has"):
        robot(modes={"navcam": requirement})


def test_a_mode_that_does_not_stream_satisfies_no_requirement() -> None:
    assert not ModeNeed().is_met_by(SensorMode(on=False))


@pytest.mark.req("CDFF-SUP-141")
def test_each_alternative_of_an_input_must_exist() -> None:
    robot(inputs={"stereo": "sensor/navcam/pair|product/other/pair"})
    with pytest.raises(ValidationError, match="no DFPC 'missing'"):
        robot(inputs={"stereo": "sensor/navcam/pair|product/missing/pair"})


def test_the_fastest_sequence_between_two_modes_is_selected() -> None:
    transitions = {"off": {"slow": 5.0, "mono": 1.0}, "mono": {"slow": 1.0}, "slow": {}}
    sensor = Sensor.model_validate(NAVCAM | {"transitions": transitions})
    assert sensor.mode_path("off", "slow") == (("mono", 1.0), ("slow", 1.0))
    assert sensor.mode_path("off", "off") == ()
    assert sensor.mode_path("slow", "off") is None
    assert sensor.mode_path("fast", "off") == (("off", 0.5),), (
        "a mode without listed transitions reaches every mode in switch_s"
    )
    with pytest.raises(ValidationError, match="not among modes"):
        Sensor.model_validate(NAVCAM | {"transitions": {"off": {"x_ray": 1.0}}})


def test_an_input_may_be_a_product_of_any_robot_in_the_dpm() -> None:
    entry = robot(inputs={"stereo": "dpm/orbiter/dem"}).robots[0].dfpcs[0]
    assert entry.inputs == {"stereo": "dpm/orbiter/dem"}
    with pytest.raises(ValidationError, match="dpm/orbiter"):
        robot(inputs={"stereo": "dpm/orbiter"})


def test_a_required_input_needs_a_source() -> None:
    assert robot(required_inputs=["stereo"]).robots[0].dfpcs[0].required_inputs == ("stereo",)
    with pytest.raises(ValidationError, match=r"requires inputs without a source: \['mask'\]"):
        robot(required_inputs=["stereo", "mask"])

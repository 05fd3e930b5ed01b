# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the gateway to ROCK: types of inputs contain a time, and no port or stream occurs twice."""

from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from services.gateway_rock.settings import RockSettings

_INPUT = {"task": "odometry", "port": "pose", "stream": "wheels/pose", "frame": "mana/odom"}


def _settings(*types: str) -> dict[str, Any]:
    return {"robot": "mana", "inputs": [{**_INPUT, "type": name} for name in types]}


@pytest.mark.parametrize(
    "name",
    ["/base/samples/RigidBodyState", "/base/samples/frame/Frame", "/base/commands/Joints"],
)
def test_types_with_a_time_of_capture_are_accepted(name: str) -> None:
    (entry,) = RockSettings.model_validate(_settings(name)).inputs
    assert entry.type == name


@pytest.mark.parametrize(
    "name",
    ["/base/Angle", "/base/Pose", "/base/commands/Motion2D", "/wrappers/Matrix</double,3,1>", "/other"],
)
def test_types_without_a_time_of_capture_are_refused(name: str) -> None:
    with pytest.raises(ValidationError, match=r"expected one of /base/commands/Joints, /base/samples/"):
        RockSettings.model_validate(_settings(name))


def test_a_port_that_occurs_twice_is_refused() -> None:
    with pytest.raises(ValidationError, match=r"input port occurs twice: odometry\.pose"):
        RockSettings.model_validate(_settings(*["/base/samples/RigidBodyState"] * 2))

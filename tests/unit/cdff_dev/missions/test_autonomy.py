# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The autonomy meets another robot only when the final position of that robot is known."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.profile import load_profile
from cdff_common.mission_clock import MissionClock
from cdff_common.resources import deploy_folder
from cdff_dev.missions.autonomy import Autonomy
from cdff_dev.missions.script import load_mission


@pytest.mark.parametrize(
    ("sigma_m", "tasks_ended", "is_settled"),
    [(0.15, True, True), (0.15, False, False), (1.5, True, False), (None, True, False)],
)
def test_a_robot_is_met_only_after_its_tasks_ended_and_with_a_known_position(
    sigma_m: float | None, tasks_ended: bool, is_settled: bool
) -> None:
    mission, tasks_ended_event = (
        load_mission(deploy_folder() / "missions" / "rendezvous.yaml"),
        threading.Event(),
    )
    profile = load_profile(deploy_folder() / "profiles" / "two_rovers.yaml")
    rover = Autonomy(
        "mana",
        mission.robots["mana"],
        mission.guidance,
        profile,
        MissionClock(),
        0,
        "",
        threading.Event(),
        lambda _text: None,
        {"minnie": tasks_ended_event},
    )
    covariance = None if sigma_m is None else np.diag([0.01, sigma_m**2, 9.0, 1.0, 1.0, 1.0])
    client: Any = SimpleNamespace(pose=lambda _robot: UncertainTransform(np.eye(4), covariance))
    rover._client = client
    if tasks_ended:
        tasks_ended_event.set()
    assert rover._is_settled("minnie") is is_settled

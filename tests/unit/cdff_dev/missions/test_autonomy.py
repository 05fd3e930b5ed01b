# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The simulated autonomy avoids another robot only at its known parking position."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cdff_common.clock import MissionClock
from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.profile import load_profile
from cdff_common.resources import deploy_folder
from cdff_dev.missions.autonomy import Autonomy
from cdff_dev.missions.script import load_mission


@pytest.mark.parametrize(
    ("sigma_m", "ended", "settled"),
    [(0.15, True, True), (0.15, False, False), (1.5, True, False), (None, True, False)],
)
def test_a_robot_is_avoided_only_at_its_known_parking_position(
    sigma_m: float | None, ended: bool, settled: bool
) -> None:
    mission, done = load_mission(deploy_folder() / "missions" / "rendezvous.yaml"), threading.Event()
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
        {"minnie": done},
    )
    covariance = None if sigma_m is None else np.diag([0.01, sigma_m**2, 9.0, 1.0, 1.0, 1.0])
    client: Any = SimpleNamespace(pose=lambda _robot: UncertainTransform(np.eye(4), covariance))
    rover._client = client
    if ended:
        done.set()
    assert rover._settled("minnie") is settled

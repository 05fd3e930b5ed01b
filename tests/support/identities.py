# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Identities of a mission for tests, and buses opened with them."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import patch

from cdff_common.bus import Bus
from cdff_common.bus.identity import VARIABLE
from cdff_common.interfaces.profile import Profile
from services.keys.access_control import Kind
from services.keys.mission_keys import MissionKeys

PROFILE = Profile.model_validate({"name": "test", "robots": [{"id": "mana"}, {"id": "minnie"}]})


def make_identities(folder: Path) -> MissionKeys:
    """Issue certificates for both robots, an operator, a reader, a client and a player."""
    keys = MissionKeys.create(folder, PROFILE, ())
    for robot in PROFILE.robot_ids:
        keys.issue(robot, Kind.ROBOT)
    keys.issue("alice", Kind.OPERATOR)
    keys.issue("eve", Kind.OPERATOR, role="reader")
    keys.issue("autonomy", Kind.CLIENT)
    keys.issue("player", Kind.PLAYER)
    return keys


def open_as(folder: Path, endpoint: str, *, wait_s: float = 10.0) -> Bus:
    """Open a bus with the identity in a folder."""
    with patch.dict("os.environ", {VARIABLE: str(folder)}):
        return Bus.open(endpoint, name=folder.name, wait_s=wait_s)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Control of robots: bodies of a hand-over, records of the journal, and switching by the owner only."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.interfaces.profile import load_profile, profile_of_scope, scopes_of
from cdff_core.orchestration.journal import recover
from cdff_core.orchestration.reconciliation import Activate, Configure, Deactivate
from cdff_core.orchestration.world import ProviderId, SensorId
from services.orchestrator.control import parse_hand_over, record_changes
from services.orchestrator.journal import Journal
from services.orchestrator.state import SystemState

PROFILE = load_profile(Path(__file__).parents[4] / "deploy" / "profiles" / "rover_traverse.yaml")
MAPPER, LIDAR = ProviderId("mana", "digital_elevation_mapping"), SensorId("mana", "lidar")


def test_a_hand_over_names_dfpcs_and_sensors_of_the_robot() -> None:
    body = {"owned": [str(MAPPER)], "sensors": [str(LIDAR)]}
    assert parse_hand_over(body, PROFILE.robot("mana")) == ({MAPPER}, {LIDAR})
    assert parse_hand_over({}, PROFILE.robot("mana")) == (set(), set())


@pytest.mark.parametrize(
    ("body", "fault"),
    [
        ([], "expected a map"),
        ({"own": []}, "expected a map"),
        ({"owned": "mana/lidar"}, "expected a list"),
        ({"sensors": [1]}, "expected a list"),
        ({"owned": ["minnie/slam"]}, "expected mana/NAME"),
        ({"owned": ["slam"]}, "expected mana/NAME"),
        ({"owned": ["mana/strange"]}, "'mana/strange', expected mana/NAME of the profile"),
        ({"sensors": ["mana/strange"]}, "'mana/strange', expected mana/NAME of the profile"),
    ],
)
def test_a_malformed_hand_over_is_refused(body: Any, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        parse_hand_over(body, PROFILE.robot("mana"))


def test_what_was_handed_back_is_not_owned_after_a_restart(tmp_path: Path) -> None:
    with closing(Journal(tmp_path / "journal.jsonl")) as journal:
        check_records(journal)


def check_records(journal: Journal) -> None:
    record_changes(journal, {MAPPER}, {LIDAR}, "taken over")
    taken = recover(journal.records())
    assert (taken.owned, taken.modes) == ({MAPPER}, {LIDAR})
    journal.append("control", robot="minnie", action="hand_back")
    assert recover(journal.records()).owned == {MAPPER}
    journal.append("control", robot="mana", action="hand_back")
    handed_back = recover(journal.records())
    assert (handed_back.owned, handed_back.modes) == (set(), set())


def test_only_the_owner_of_a_robot_switches_its_dfpcs_and_sensors() -> None:
    state = SystemState(PROFILE)
    state.set_alive(MAPPER, alive=True)
    state.set_state(MAPPER, "active")
    state.set_owned(MAPPER, owned=True)
    assert Deactivate(MAPPER) in state.actions()[0]
    state.set_control("mana", controlled=False)
    assert not state.controls("mana")
    assert state.changes("mana") == ({MAPPER}, set())
    assert Deactivate(MAPPER) not in state.actions()[0]
    assert not [a for a in state.actions()[0] if isinstance(a, (Activate, Configure))]
    state.set_control("mana", controlled=True)
    assert state.controls("mana")


def test_the_scope_selects_a_part_of_the_profile() -> None:
    profile = PROFILE
    assert profile_of_scope(profile, "mana").robot_ids == ("mana",)
    assert profile_of_scope(profile, "ground") is profile_of_scope(profile, "") is profile
    with pytest.raises(ConfigurationError, match=r"--scope luna: profile .* has ground and mana, minnie"):
        profile_of_scope(profile, "luna")
    assert scopes_of(["a", "b"], "ground") == scopes_of(["a", "b"], "") == ("a", "b", "ground")
    assert scopes_of(["a", "b"], "b") == ("b",)

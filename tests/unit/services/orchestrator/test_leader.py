# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Election of a leader: of processes without a serving one, the earliest; a serving one keeps the lead."""

from __future__ import annotations

from collections.abc import Set
from fnmatch import fnmatch

import pytest

from cdff_common.bus import keys
from cdff_common.errors import UnavailableError
from services.orchestrator import leader
from services.orchestrator.leader import ProcessIdentity, claim, claim_robot

SCOPES = ("mana", "ground")
EARLIER, LATER = (ProcessIdentity(since_ns, 7, "other_host") for since_ns in (1, 2**62))


class Bus:
    """Bus double with tokens of other processes, of which some appear after the first look."""

    def __init__(self, present: Set[str] = frozenset(), late: Set[str] = frozenset()) -> None:
        self.present, self.late, self.own = set(present), late, set[str]()

    def declare_token(self, key: str) -> None:
        self.own.add(key)

    def has_token(self, key: str) -> bool:
        return key in self.own

    def alive(self, keyexpr: str) -> set[str]:
        return {key for key in self.own | self.present if fnmatch(key, keyexpr)}

    def pause(self, pause_s: float) -> None:
        if pause_s > 0.0:
            self.present |= self.late


def claimed(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> ProcessIdentity:
    monkeypatch.setattr(leader.time, "sleep", bus.pause)
    return claim(bus, SCOPES)  # type: ignore[arg-type]  # double


def test_a_process_without_others_leads_all_scopes(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Bus()
    own = claimed(bus, monkeypatch)
    assert bus.own == {keys.lead(scope, own.name) for scope in SCOPES}


@pytest.mark.parametrize("is_late", [False, True])
@pytest.mark.parametrize("scope", SCOPES)
def test_an_earlier_process_leads_also_if_its_token_is_visible_only_after_a_pause(
    monkeypatch: pytest.MonkeyPatch, scope: str, is_late: bool
) -> None:
    tokens = {keys.lead(scope, EARLIER.name), keys.lead(scope, LATER.name)}
    with pytest.raises(
        UnavailableError, match=f"another orchestrator leads {scope}: process 7 on other_host"
    ):
        claimed(Bus(late=tokens) if is_late else Bus(tokens), monkeypatch)


def test_a_later_process_does_not_take_the_lead_unless_it_serves(monkeypatch: pytest.MonkeyPatch) -> None:
    token = keys.lead("mana", LATER.name)
    claimed(Bus({token}), monkeypatch)
    with pytest.raises(UnavailableError, match="leads mana: process 7 on other_host"):
        claimed(Bus({token, keys.alive("mana", "orchestrator")}), monkeypatch)


def test_a_process_that_serves_a_scope_leads_it_also_without_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(UnavailableError, match="another orchestrator leads ground; stop it first"):
        claimed(Bus({keys.alive("ground", "orchestrator")}), monkeypatch)


def test_a_robot_that_joins_must_not_be_served_by_another_process() -> None:
    token = keys.alive("mana", "orchestrator")
    claim_robot(Bus(), "mana")  # type: ignore[arg-type]  # double
    with pytest.raises(UnavailableError, match="another orchestrator leads mana"):
        claim_robot(Bus({token}), "mana")  # type: ignore[arg-type]  # double
    own = Bus()
    own.declare_token(token)
    claim_robot(own, "mana")  # type: ignore[arg-type]  # double


def test_the_name_of_a_process_in_its_token_is_read_back() -> None:
    own = ProcessIdentity.own()
    assert ProcessIdentity.parse(own.name) == own

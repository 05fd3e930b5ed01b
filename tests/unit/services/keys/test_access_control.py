# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

from typing import Any

from services.keys.access_control import Kind, Member, ground_list, robot_list

GROUND = Member("ground", Kind.GROUND, "operator", ("ground.1",))
MANA = Member("mana", Kind.ROBOT, "robot", ("mana.1",))
MINNIE = Member("minnie", Kind.ROBOT, "robot", ("minnie.1",))
AUTONOMY = Member("autonomy", Kind.CLIENT, "reader", ("autonomy.1",))
ALICE = Member("alice", Kind.OPERATOR, "operator", ("alice.1",))
EVERYONE = (GROUND, MANA, MINNIE, AUTONOMY, ALICE)


def keys_of(access: dict[str, Any], name: str, message: str) -> set[str]:
    return {
        key.removeprefix("cdff/@v1/")
        for rule in access["rules"]
        if rule["id"].startswith(f"{name}-") and message in rule["messages"]
        for key in rule["key_exprs"]
    }


def test_everything_that_is_not_granted_is_denied_and_no_rule_denies() -> None:
    access = ground_list(EVERYONE, "player")
    assert access["default_permission"] == "deny"
    assert {rule["permission"] for rule in access["rules"]} == {"allow"}
    assert {s["id"]: s["cert_common_names"] for s in access["subjects"]}["mana"] == ["mana.1"]


def test_a_robot_offers_below_its_own_scope_only() -> None:
    access = ground_list(EVERYONE, "player")
    for message in ("put", "delete", "declare_queryable", "reply", "liveliness_token"):
        assert keys_of(access, "mana", message) == {
            "mana/**",
            "mana/**/@rpc/**",
            "mana/@alive/*",
            "mana/@lead/*",
        }


def test_clients_and_operators_publish_nothing() -> None:
    access = ground_list(EVERYONE, "player")
    for name in ("autonomy", "alice"):
        assert not keys_of(access, name, "put")
        assert not keys_of(access, name, "declare_queryable")


def test_only_the_named_identity_may_publish_the_clock() -> None:
    for publisher in ("mana", "ground"):
        access = ground_list(EVERYONE, publisher)
        allowed = {m.name for m in EVERYONE if "ground/clock" in keys_of(access, m.name, "put")}
        assert allowed == {publisher}
        assert "ground/**" not in keys_of(access, "ground", "put")


def test_the_router_of_a_robot_admits_its_robot_the_ground_and_programs_but_no_operator() -> None:
    access = robot_list("mana", EVERYONE, "player")
    assert [s["id"] for s in access["subjects"]] == ["ground", "mana", "autonomy"]

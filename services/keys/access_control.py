# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Access-control lists of routers: the messages that each identity may send; all others are refused.

A router checks the messages that it receives from an identity. All identities of the mission may read:
subscribe, ask for liveliness, and query status and stores. Zenoh's ``**`` does not match chunks like
``@rpc``, so that calls and liveliness tokens are named.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from cdff_common.bus.keys import CLOCK, GROUND, PREFIX

_READ = ("declare_subscriber", "liveliness_query", "declare_liveliness_subscriber")
_OFFER = ("put", "delete", "declare_queryable", "reply", "liveliness_token")
_QUERY = ("query",)
_ALL = (*_READ, *_OFFER, *_QUERY)
_EVERYWHERE = ("**", "**/@rpc/**", "*/@alive/*", "*/@lead/*")
_CALLS = ("**/@rpc/**",)

_DPM_READS = ("search", "get", "pose", "stat", "changes", "provenance", "profile", "robots", "alarms")
#: Calls that change nothing.
_READING_CALLS = (
    *(f"*/dpm/@rpc/{verb}" for verb in _DPM_READS),
    *(f"*/orchestrator/@rpc/{verb}" for verb in ("jobs", "catalogue", "stat")),
    "*/icu/@rpc/modes",
    *(f"*/dfpc/*/@rpc/{verb}" for verb in ("status", "describe")),
    "*/supervisor/@rpc/profile",
)
_REQUESTS = tuple(f"orchestrator/@rpc/{verb}" for verb in ("request", "cancel", "renew"))
#: Shared services answer under every scope.
_GROUND_OFFERS = (
    "*/event/*",
    "*/dpm/**",
    *(f"*/{service}/@rpc/**" for service in ("dpm", "orchestrator", "icu")),
    *(f"*/@alive/{service}" for service in ("dpm", "orchestrator", "orchestrator_ground", "icu")),
    f"{GROUND}/supervisor/@rpc/**",
    f"{GROUND}/@alive/*",
    f"{GROUND}/alarms/*",
    "*/@lead/*",
)
_PLAYER_OFFERS = (
    "*/sensor/**",
    f"{GROUND}/event/playback",
    f"{GROUND}/player/@rpc/**",
    "*/simulator/@rpc/**",
    "*/@alive/simulator",
)


class Kind(StrEnum):
    """Kind of an identity."""

    GROUND = "ground"  # the shared services: DPM, orchestrator, ICU, merging
    ROBOT = "robot"  # publishes and answers below its own scope
    OPERATOR = "operator"  # a person, with a role
    CLIENT = "client"  # an autonomy framework (OG2): asks, and publishes nothing
    PLAYER = "player"  # plays or simulates the sensors of all robots


@dataclass(frozen=True, slots=True)
class Member:
    """An identity with certificates that are accepted.

    Attributes
    ----------
    name : str
        Id of a robot, ``ground``, or the name of a person or program.
    kind : Kind
    role : str
        Role at the DPM: reader, robot, operator or admin.
    common_names : tuple of str
        Common names of its certificates.
    """

    name: str
    kind: Kind
    role: str
    common_names: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Grant:
    """Messages that an identity may send on key expressions below ``cdff/@v1/``."""

    messages: Sequence[str]
    keys: Sequence[str]


def ground_list(members: Iterable[Member], clock: str) -> dict[str, Any]:
    """Return the list of the ground's router; ``clock`` is the name that may publish the mission clock."""
    return _access_list({member: grants(member, clock) for member in members})


def robot_list(robot: str, members: Iterable[Member], clock: str) -> dict[str, Any]:
    """Return the list of a robot's own router.

    The link to the router of the ground carries the messages of all identities that are accepted there.
    """
    on_board = {}
    for member in members:
        if member.kind is Kind.GROUND:
            on_board[member] = [Grant(_ALL, _EVERYWHERE)]
        elif member.name == robot or member.kind in (Kind.CLIENT, Kind.PLAYER):
            on_board[member] = grants(member, clock)
    return _access_list(on_board)


def grants(member: Member, clock: str) -> list[Grant]:
    """Return what an identity may send to the router of the ground."""
    granted = [Grant(_READ, _EVERYWHERE), Grant(_QUERY, ("**", *_READING_CALLS))]
    if member.kind is Kind.GROUND:
        granted += [Grant(_OFFER, _GROUND_OFFERS), Grant(_QUERY, _CALLS)]
    elif member.kind is Kind.ROBOT:
        own_keys = [member.name + below for below in ("/**", "/**/@rpc/**", "/@alive/*", "/@lead/*")]
        granted += [
            Grant(_OFFER, own_keys),
            Grant(_QUERY, (own_keys[1], *(f"{GROUND}/{r}" for r in _REQUESTS))),
        ]
    elif member.kind is Kind.PLAYER:
        granted.append(Grant(_OFFER, _PLAYER_OFFERS))
    elif member.kind is Kind.CLIENT:
        query_keys = (*(f"*/{r}" for r in _REQUESTS), "*/dfpc/*/@rpc/call/*", "*/simulator/@rpc/*")
        granted.append(Grant(_QUERY, query_keys))
    elif member.role != "reader":
        granted.append(Grant(_QUERY, _CALLS))
    if member.name == clock:
        granted.append(Grant(("put",), (CLOCK.removeprefix(f"{PREFIX}/"),)))
    return granted


def _access_list(granted: Mapping[Member, Sequence[Grant]]) -> dict[str, Any]:
    rules = [_rule("deliver", "egress", Grant(_ALL, _EVERYWHERE))]
    subjects, policies = [], []
    for member, member_grants in granted.items():
        member_rules = [
            _rule(f"{member.name}-{i}", "ingress", grant) for i, grant in enumerate(member_grants)
        ]
        rules += member_rules
        subjects.append({"id": member.name, "cert_common_names": list(member.common_names)})
        policies.append(
            {"subjects": [member.name], "rules": ["deliver", *(rule["id"] for rule in member_rules)]}
        )
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(name: str, flow: str, grant: Grant) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": [flow],
        "messages": list(grant.messages),
        "key_exprs": [f"{PREFIX}/{key}" for key in grant.keys],
    }

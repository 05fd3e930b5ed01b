# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Profiles that a supervisor serves: that of the ground, or those of robots that join a ground elsewhere."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cdff_common.bus import Bus, Reply, Request, keys
from cdff_common.bus.identity import Identity
from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.robot_profile import RobotProfile


@dataclass(frozen=True, slots=True)
class SupervisorLink:
    """Connection of a supervisor to the bus.

    Attributes
    ----------
    connect : str
        Endpoint of the router.
    scope : str
        Scope of the supervisor's alarms.
    profiles : mapping of str to mapping
        Profile in plain data by the scope under which it is served.
    secrets : Path or None
        Folder of ``cdff keys``: each scope is served with its own identity.
    """

    connect: str
    scope: str
    profiles: Mapping[str, Mapping[str, Any]]
    secrets: Path | None = None

    def identity_of(self, scope: str) -> Identity | None:
        """Return the identity of a scope; None without ``secrets``."""
        return None if self.secrets is None else Identity.read(self.secrets / scope)


def served_profiles(profile: Profile, scopes: Collection[str]) -> dict[str, Mapping[str, Any]]:
    """Return the profiles that a supervisor of some scopes (empty: all) serves, by scope.

    With ``ground`` among them it is the whole profile, which the shared services have read already.
    """
    if not scopes or keys.GROUND in scopes:
        return {keys.GROUND: profile.model_dump(mode="json", exclude_defaults=True)}
    return {r: RobotProfile.of(profile, r).to_dict() for r in profile.robot_ids if r in scopes}


def serve_profile(bus: Bus, scope: str, profile: Mapping[str, Any]) -> None:
    """Serve a profile under a scope and announce the supervisor there."""

    def answer(_: Request) -> Reply:
        return Reply.of(profile)

    bus.serve(keys.supervisor_rpc(scope, "profile"), answer, workers=1)
    bus.declare_alive(scope, "supervisor")

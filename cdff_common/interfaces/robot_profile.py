# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Profile of one robot as its supervisor publishes it, for the shared services of a ground that it joins."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from pydantic import ValidationError

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.profile import Profile, Robot

#: Hexadecimal digits of the hash that identify a revision of the profile.
_REVISION_DIGITS = 12


@dataclass(frozen=True, slots=True)
class RobotProfile:
    """The part of a mission profile that concerns one robot.

    Attributes
    ----------
    profile : Profile
        Mission name, body and history policies, with one robot only.
    """

    profile: Profile

    @classmethod
    def of(cls, profile: Profile, robot_id: str) -> Self:
        """Return the part of one robot; raises ConfigurationError for an unknown robot."""
        robot = profile.robot(robot_id)
        history = tuple(
            policy
            for policy in profile.history
            if policy.robot in (None, robot_id)
            and policy.sensor in robot.sensors
            and policy.stream in robot.sensors[policy.sensor].streams
        )
        robot_without_gateways = robot.model_copy(
            update={"gateways": {}}
        )  # files of the machine of the robot
        part = {"robots": (robot_without_gateways,), "history": history, "retention": (), "merging": None}
        return cls(profile.model_copy(update=part))

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.profile.robots[0]

    @property
    def revision(self) -> str:
        """First digits of the SHA-256 of the content: two profiles differ if their revisions differ."""
        text = json.dumps(self.profile.model_dump(mode="json"), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:_REVISION_DIGITS]

    def to_dict(self) -> dict[str, Any]:
        """Return plain data without default values, so that an older receiver has all fields."""
        return self.profile.model_dump(mode="json", exclude_defaults=True)

    @classmethod
    def from_dict(cls, data: object, robot_id: str) -> Self:
        """Return the profile of a robot in ``data``.

        Raises
        ------
        ConfigurationError
            If the data are no valid profile of this robot alone.
        """
        if not isinstance(data, Mapping):
            raise ConfigurationError(f"profile of {robot_id}: got {type(data).__name__}, expected a map")
        try:
            profile = Profile.model_validate(data)
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"]) or "profile"
            raise ConfigurationError(
                f"profile of {robot_id}: {where}: {first['msg']}; its machine may run another version"
            ) from error
        if profile.robot_ids != (robot_id,):
            raise ConfigurationError(
                f"profile of {robot_id}: it has the robots {', '.join(profile.robot_ids)}, "
                f"expected {robot_id}"
            )
        return cls(profile)

    def check_joins(self, ground: Profile) -> None:
        """Raise ConfigurationError if the robot cannot join the mission of a ground.

        Both need one body, one location of each site that both anchor, and one clock: maps and poses of the
        robot would otherwise lie elsewhere.
        """
        profile, robot_id = self.profile, self.robot.id
        for name in ("name", "kind", "crs", "radii_m"):
            mine, theirs = getattr(profile.body, name), getattr(ground.body, name)
            if mine != theirs:
                raise ConfigurationError(
                    f"robot {robot_id}: body.{name} is {mine!r}, but {theirs!r} in the profile "
                    f"{ground.name} of the ground; use one body"
                )
        for frame, anchor in profile.body.anchors.items():
            expected = ground.body.anchors.get(frame)
            if expected is not None and expected != anchor:
                raise ConfigurationError(
                    f"robot {robot_id}: {frame} is at longitude {anchor.lon_deg:g}°, latitude "
                    f"{anchor.lat_deg:g}°, height {anchor.height_m:g} m, azimuth {anchor.azimuth_deg:g}°, "
                    f"elsewhere than in the profile {ground.name} of the ground; use one location, or omit it"
                )
        if profile.clock != ground.clock:
            raise ConfigurationError(
                f"robot {robot_id}: clock is {profile.clock!r}, but {ground.clock!r} in the profile "
                f"{ground.name} of the ground; use one mission clock"
            )


def with_robot(profile: Profile, joined: RobotProfile) -> Profile:
    """Return a profile in which a joined robot is added, or replaces the robot of the same id."""
    others = tuple(r for r in profile.robots if r.id != joined.robot.id)
    is_known = len(others) < len(profile.robots)
    order = profile.robot_ids if is_known else (*profile.robot_ids, joined.robot.id)
    by_id = {r.id: r for r in (*others, joined.robot)}
    return profile.model_copy(update={"robots": tuple(by_id[name] for name in order)})

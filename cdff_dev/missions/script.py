# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a mission is: one strict model of ``deploy/missions/*.yaml``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import StrictModel, validated
from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.yaml_file import read_mapping
from cdff_dev.demo.script import Ask
from cdff_dev.simulate.scenario import Scenario

Positive = Annotated[float, Field(gt=0)]


class Follow(StrictModel):
    """Drive the scenario's own way; whoever drives does not look at maps."""

    do: Literal["follow"]


class Straight(StrictModel):
    """Drive straight ahead, as from a lander's ramp, before anything is mapped."""

    do: Literal["straight"]
    length_m: Positive


class GoTo(StrictModel):
    """Be guided to a place of the site."""

    do: Literal["go_to"]
    xy_m: tuple[float, float]


class Meet(StrictModel):
    """Be guided to another robot, as far as ``keep_m`` from where the DPM says it is."""

    do: Literal["meet"]
    robot: str
    keep_m: Positive


class Return(StrictModel):
    """Be guided back to where the rover was when the mission began."""

    do: Literal["return"]


Task = Annotated[Follow | Straight | GoTo | Meet | Return, Field(discriminator="do")]


class Guiding(StrictModel):
    """How a rover is guided.

    ``ground`` is what the orchestrator is asked for: the robot's own ``navigation_map``, or the ``dem`` of all robots,
    rated here by the profile's limits of the robot.
    """

    ground: Literal["navigation_map", "dem"] = "navigation_map"
    around_m: Positive = 18.0
    resolution_m: Positive = 0.2
    leg_m: Positive = 7.0
    max_age_s: Positive = 6.0
    arrived_m: Annotated[Positive, Field(description="a goal is reached within this, as the rover believes")] = 0.5
    most_legs: Annotated[int, Field(gt=0)] = 400


class Judged(StrictModel):
    """What must hold at the end, against the truth.

    Attributes
    ----------
    position_share : float or None
        Largest error of the position on the way, as a share of the way driven; None where it is not judged.
    goal_m : float
        How far from each goal a rover may truly be when it says that it is there.
    least_way_m : float
        Each rover drives at least so far.
    three_sigma_share : float
        At least so many of the positions lie within three stated sigmas of the truth.
    elevation_rms_m : float
        Largest root mean square error of the elevation along the way, which must be there at every place looked at.
    steeper_deg, higher_m : float
        No place on a guided way may be beyond the profile's limits by more: what is called safe is so at three sigmas.
    guided : bool
        Whether the way is judged at all: guidance chose it.
    """

    position_share: Positive | None = 0.01
    goal_m: Positive = 1.0
    least_way_m: Annotated[float, Field(ge=0)] = 0.0
    three_sigma_share: Annotated[float, Field(ge=0, le=1)] = 0.95
    elevation_rms_m: Positive = 0.15
    steeper_deg: Annotated[float, Field(ge=0)] = 5.0
    higher_m: Annotated[float, Field(ge=0)] = 0.10
    guided: bool = True


class Together(StrictModel):
    """How well two robots must know where one is as seen from the other, at places within a distance of one another.

    ``wait_s`` is how long the merging of their maps may take after the drive.
    """

    robots: tuple[str, str]
    within_m: Positive
    at_most_m: Positive
    wait_s: Positive = 60.0


class FromOrbit(StrictModel):
    """An orbital elevation model that the DPM holds before the drive: the simulated ground, blurred and with noise.

    Attributes
    ----------
    robot : str
        Whose ``dem`` it is.
    resolution_m, half_width_m : float
        Cells, and how far it reaches.
    noise_m, alike_m : float
        Standard deviation of its heights, and how far errors of neighbours resemble one another.
    """

    robot: str = "orbiter"
    resolution_m: Positive = 1.0
    half_width_m: Positive
    noise_m: Positive = 0.15
    alike_m: Positive = 1.5


class Mission(StrictModel):
    """Contents of a mission file; ``speed`` is mission seconds per second."""

    doc: str
    profile: str
    scenario: str
    speed: Annotated[float, Field(gt=0, le=100)] = 4.0
    guiding: Guiding = Guiding()
    robots: Annotated[dict[str, tuple[Task, ...]], Field(min_length=1)]
    requests: tuple[Ask, ...] = ()
    orbital: FromOrbit | None = None
    judged: Judged = Judged()
    together: Together | None = None

    @model_validator(mode="after")
    def _robots_meet_others(self) -> Mission:
        for robot, tasks in self.robots.items():
            for task in tasks:
                if isinstance(task, Meet) and (task.robot == robot or task.robot not in self.robots):
                    raise ValueError(f"robots.{robot}: cannot meet {task.robot!r}")
        return self


def check_fits(mission: Mission, profile: Profile, scenario: Scenario) -> None:
    """Raise ConfigurationError where the mission's robots are not in its profile or its scenario."""
    asked_of = {ask.robot for ask in mission.requests} | set(mission.together.robots if mission.together else ())
    for robot in sorted(set(mission.robots) | asked_of - {"any"}):
        if robot not in profile.robot_ids:
            known = ", ".join(profile.robot_ids)
            raise ConfigurationError(f"robot {robot!r}: profile {profile.name} has {known}")
    for robot in mission.robots:
        if robot not in scenario.robots:
            known = ", ".join(scenario.robots)
            raise ConfigurationError(f"robot {robot!r}: scenario {scenario.name} has {known}")


def load_mission(path: Path) -> Mission:
    """Read a mission; raises ConfigurationError naming file and key."""
    return validated(Mission, read_mapping(path), str(path))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Models of the files of missions (``deploy/missions/``) and demonstrations (``deploy/demo/``)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import StrictModel, validated
from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.yaml_file import read_mapping
from cdff_dev.simulate.fields import NotNegative, Positive
from cdff_dev.simulate.scenario import Scenario

Fraction = Annotated[float, Field(ge=0, le=1)]
#: Mission seconds per second of real time.
Speed = Annotated[float, Field(gt=0, le=100)]


class TimedRequest(StrictModel):
    """One request of OG2; all fields but ``at_s`` and ``observable`` are sent to the orchestrator unchanged.

    ``observable`` is the expected state of a track: the range is not known yet (``bearing``), or it is.
    ``provider`` is the DFPC whose product the answer is expected to be. With ``explain`` the plan of the
    orchestrator is printed before the request is sent.
    """

    at_s: NotNegative
    type: str
    robot: str
    frame: str = "site"
    region: str | None = None
    resolution_m: Positive | None = None
    max_age_s: Positive
    min_coverage: Fraction | None = None
    as_: Annotated[str | None, Field(alias="as")] = None
    format: str | None = None
    deadline_ms: Annotated[int, Field(gt=0)]
    observable: Literal["bearing", "range"] | None = None
    child: str | None = None
    max_sigma_m: Positive | None = None
    max_sigma_deg: Positive | None = None
    provider: str | None = None
    explain: bool = False

    @property
    def parameters(self) -> dict[str, Any]:
        """Keyword arguments of ``Client.request`` except the type."""
        options = self.model_dump(
            exclude={"at_s", "type", "as_", "deadline_ms", "observable", "provider", "explain"},
            exclude_none=True,
        )
        options |= {} if self.as_ is None else {"as_type": self.as_}
        return {**options, "deadline_s": self.deadline_ms / 1000}

    @property
    def title(self) -> str:
        """Description in one line."""
        cells = f"{self.resolution_m:g} m" if self.resolution_m else None
        encoding = f"as {self.as_ or self.format}" if self.as_ or self.format else None
        parts = (f"{self.type} of {self.robot} in {self.frame}", self.region, cells, encoding)
        return ", ".join(part for part in parts if part)


class Follow(StrictModel):
    """Drive the path of the scenario, without maps."""

    do: Literal["follow"]


class Straight(StrictModel):
    """Drive straight ahead without a map, for example down a lander's ramp."""

    do: Literal["straight"]
    length_m: Positive


class GoTo(StrictModel):
    """Drive with guidance to a position in site."""

    do: Literal["go_to"]
    xy_m: tuple[float, float]


class Meet(StrictModel):
    """Drive with guidance to another robot, up to ``distance_m`` from its position in the DPM."""

    do: Literal["meet"]
    robot: str
    distance_m: Positive


class Return(StrictModel):
    """Drive with guidance back to the start of the mission."""

    do: Literal["return"]


Task = Annotated[Follow | Straight | GoTo | Meet | Return, Field(discriminator="do")]


class GuidanceParameters(StrictModel):
    """Parameters of the guidance.

    ``ground`` is the requested product: the ``navigation_map`` of the robot itself, or the ``dem`` of all
    robots, from which a navigation map is computed with the limits of the robot in the profile.
    """

    ground: Literal["navigation_map", "dem"] = "navigation_map"
    around_m: Positive = 18.0
    resolution_m: Positive = 0.2
    leg_m: Positive = 7.0
    max_age_s: Positive = 6.0
    goal_radius_m: Annotated[
        Positive, Field(description="estimated distance within which a goal is reached")
    ] = 0.5
    max_legs: Annotated[int, Field(gt=0)] = 400


class MissionLimits(StrictModel):
    """Limits at the end of the mission, relative to the ground truth.

    Attributes
    ----------
    position_error_ratio : float or None
        Largest position error as a fraction of the path length; None for no limit.
    goal_m : float
        Largest true distance from a goal that a rover reports as reached.
    min_path_length_m : float
        Smallest path length of each rover.
    three_sigma_fraction : float
        Smallest fraction of the positions within three stated standard deviations of the truth.
    elevation_rms_m : float
        Largest root mean square error of the elevation along the path. An elevation map must exist at every
        compared pose.
    slope_excess_deg, step_excess_m : float
        Largest excess over the limits of the profile on a guided path. The limits alone would be too strict:
        the maps on which the path is planned have errors.
    guided : bool
        True if guidance selects the path; the terrain along it is then compared with the limits.
    """

    position_error_ratio: Positive | None = 0.01
    goal_m: Positive = 1.0
    min_path_length_m: NotNegative = 0.0
    three_sigma_fraction: Fraction = 0.95
    elevation_rms_m: Positive = 0.15
    slope_excess_deg: NotNegative = 5.0
    step_excess_m: NotNegative = 0.10
    guided: bool = True


class RelativePositionLimit(StrictModel):
    """Largest error of the relative position of two robots, at poses within ``within_m`` of each other.

    ``wait_s`` limits the time for merging their maps after the drive.
    """

    robots: tuple[str, str]
    within_m: Positive
    max_error_m: Positive
    wait_s: Positive = 60.0


class SharedMapLimits(RelativePositionLimit):
    """Limits of a map that two robots share, and region and resolution of the compared elevation map."""

    region: str
    resolution_m: Positive


class OrbitalModel(StrictModel):
    """An orbital elevation model, stored in the DPM before the drive: true terrain, blurred and with noise.

    It is the product ``dem`` of ``robot``; ``noise_m`` is the standard deviation of its heights.
    """

    robot: str = "orbiter"
    resolution_m: Positive = 1.0
    half_width_m: Positive
    noise_m: Positive = 0.15
    correlation_length_m: Positive = 1.5


class EarlierDrive(StrictModel):
    """An earlier drive whose images become the visual map of ``robot`` in the DPM, before the mission.

    The rover follows the path of ``scenario``; ``visual_slam`` makes the map, whose frame is ``frame``.
    """

    scenario: str
    robot: str
    frame: str


class Mission(StrictModel):
    """Contents of a mission file without ``without_lidar``, see ``load_mission``."""

    doc: str
    profile: str
    scenario: str
    speed: Speed = 4.0
    guidance: GuidanceParameters = GuidanceParameters()
    robots: Annotated[dict[str, tuple[Task, ...]], Field(min_length=1)]
    requests: tuple[TimedRequest, ...] = ()
    orbital: OrbitalModel | None = None
    earlier_drive: EarlierDrive | None = None
    limits: MissionLimits = MissionLimits()
    relative_position: RelativePositionLimit | None = None

    @model_validator(mode="after")
    def _check_meetings(self) -> Mission:
        for robot, tasks in self.robots.items():
            for task in tasks:
                if isinstance(task, Meet) and (task.robot == robot or task.robot not in self.robots):
                    raise ValueError(f"robots.{robot}: cannot meet {task.robot!r}")
        return self


class Script(StrictModel):
    """Contents of the file of a demonstration: the requests that are sent while a log is played.

    ``scenario`` is the simulated scenario, by default that of the name of the file. ``models`` are the meshes
    of objects, built-in ones of the simulator or files, which are uploaded to the DPM before the start.
    """

    profile: str
    scenario: str | None = None
    rate: Speed = 1.0
    models: dict[str, str] = {}
    requests: Annotated[tuple[TimedRequest, ...], Field(min_length=1)]
    sharing: SharedMapLimits | None = None


def check_fits(mission: Mission, profile: Profile, scenario: Scenario) -> None:
    """Raise ConfigurationError if a robot of the mission is not in its profile or scenario."""
    requested = {request.robot for request in mission.requests} | set(
        mission.relative_position.robots if mission.relative_position else ()
    )
    for robot in sorted(set(mission.robots) | requested - {"any"}):
        if robot not in profile.robot_ids:
            known = ", ".join(profile.robot_ids)
            raise ConfigurationError(f"robot {robot!r}: profile {profile.name} has {known}")
    for robot in mission.robots:
        if robot not in scenario.robots:
            known = ", ".join(scenario.robots)
            raise ConfigurationError(f"robot {robot!r}: scenario {scenario.name} has {known}")


def load_mission(path: Path, *, without_lidar: bool = False) -> Mission:
    """Read a mission, or its variant without a lidar.

    The section ``without_lidar`` of the file contains the fields that differ in the variant.

    Raises
    ------
    ConfigurationError
        Naming file and key, or that the mission has no such variant.
    """
    data = read_mapping(path)
    variant = data.pop("without_lidar", None)
    if not without_lidar:
        return validated(Mission, data, str(path))
    if not isinstance(variant, dict):
        raise ConfigurationError(
            f"{path}: without_lidar: expected a section with the fields that differ; the mission "
            "has no variant without a lidar"
        )
    return validated(Mission, data | variant, f"{path}, without_lidar")


def load_script(path: Path) -> Script:
    """Read the script of a demonstration; raises ConfigurationError naming file and key."""
    return validated(Script, read_mapping(path), str(path))

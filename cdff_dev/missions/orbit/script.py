# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Model of the files of missions in orbit (``deploy/missions/``, ``kind: orbit``)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import StrictModel, validated
from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.yaml_file import read_mapping
from cdff_dev.missions.script import Fraction, Speed, TimedRequest
from cdff_dev.simulate.fields import NotNegative, Positive
from cdff_dev.simulate.orbit.scenario import OrbitScenario

KIND = "orbit"


class Wait(StrictModel):
    """Keep the position."""

    do: Literal["wait"]
    duration_s: Positive


class Approach(StrictModel):
    """Move towards the client, in several steps, each after a request of its track.

    With ``by: bearing`` the track is a direction with a range, whose lower limit decides the step; with
    ``by: pose`` it is a pose in ``frame``, a frame of the servicer. The requested accuracy selects the DFPC.
    """

    do: Literal["approach"]
    by: Literal["bearing", "pose"]
    frame: str = "inertial"
    distance_m: Annotated[Positive, Field(description="distance from the origin of the client at the end")]
    speed_m_s: Annotated[Positive, Field(description="mean speed of a step")] = 1.0
    tolerance: Annotated[Positive, Field(description="accepted relative difference of the distance")] = 0.1
    max_step_m: Positive = 1e6
    max_steps: Annotated[int, Field(gt=0)] = 12
    max_sigma_m: Positive | None = None
    max_sigma_deg: Positive | None = None


class FlyAround(StrictModel):
    """Move around the client in the plane of x and y of the base, in steps between requests of its pose.

    At each step the products in ``refresh`` are requested as well, so that their DFPCs remain active.
    """

    do: Literal["fly_around"]
    frame: str
    distance_m: Positive
    angle_deg: Annotated[float, Field(gt=-3600, lt=3600, description="positive: to the right of the client")]
    steps: Annotated[int, Field(gt=0)]
    step_s: Positive
    max_sigma_m: Positive | None = None
    max_sigma_deg: Positive | None = None
    refresh: tuple[OrbitRequest, ...] = ()


class OrbitRequest(TimedRequest):
    """A request that is sent when its task is reached."""

    at_s: NotNegative = 0.0


class Ask(StrictModel):
    """Send a request; a refusal with a reason is expected if ``expect`` is ``refusal``."""

    do: Literal["ask"]
    request: OrbitRequest
    expect: Literal["answer", "refusal"] = "answer"


class LoseSensor(StrictModel):
    """Fault: the sensor delivers no samples."""

    do: Literal["lose_sensor"]
    sensor: str
    duration_s: Positive


class RestartProcess(StrictModel):
    """Fault: a process of the servicer is killed; the supervisor starts it again."""

    do: Literal["restart_process"]
    process: Annotated[str, Field(description="name of the process in the profile")]


class CutLink(StrictModel):
    """Fault: the autonomy framework has no connection to the servicer, for ``duration_s`` of real time.

    A request is sent during the outage; it must be refused with a reason.
    """

    do: Literal["cut_link"]
    duration_s: Positive
    request: OrbitRequest


Task = Annotated[
    Wait | Approach | FlyAround | Ask | LoseSensor | RestartProcess | CutLink, Field(discriminator="do")
]


class OrbitLimits(StrictModel):
    """Limits at the end of the mission, relative to the ground truth.

    Attributes
    ----------
    min_poses : int
        Smallest number of compared poses.
    position_m, rotation_deg : float
        Largest medians of the errors of the tracked poses.
    within_three_sigma : float
        Smallest fraction of the poses whose error is within three stated standard deviations.
    model_rms_m, model_completeness : float or None
        Largest root mean square distance of the vertices of the delivered model from the true surface, and
        smallest fraction of the true surface within ``model_within_m`` of the model. None: no model.
    """

    min_poses: Annotated[int, Field(ge=0)] = 10
    position_m: Positive = 0.05
    rotation_deg: Positive = 1.0
    within_three_sigma: Fraction = 0.9
    model_rms_m: Positive | None = None
    model_completeness: Fraction | None = None
    model_within_m: Positive = 0.1


class OrbitMission(StrictModel):
    """Contents of a mission file in orbit.

    ``models`` are the meshes of objects, built-in ones of the simulator or files, which are uploaded to the
    DPM before the start.
    """

    kind: Literal["orbit"]
    doc: str
    profile: str
    scenario: str
    speed: Speed = 2.0
    models: dict[str, str] = {}
    tracker: Annotated[str, Field(description="DFPC whose poses are compared with the ground truth")]
    tasks: Annotated[tuple[Task, ...], Field(min_length=1)]
    limits: OrbitLimits = OrbitLimits()


FlyAround.model_rebuild()


def is_orbital(path: Path) -> bool:
    """Return True if a file contains a mission in orbit."""
    return read_mapping(path).get("kind") == KIND


def load_orbit_mission(path: Path) -> OrbitMission:
    """Read a mission; raises ConfigurationError naming file and key."""
    return validated(OrbitMission, read_mapping(path), str(path))


def check_fits(mission: OrbitMission, profile: Profile, scenario: OrbitScenario) -> None:
    """Raise ConfigurationError if the servicer, sensors or processes of a mission are not in its profile."""
    name = scenario.servicer.name
    if name not in profile.robot_ids:
        raise ConfigurationError(
            f"servicer {name!r}: profile {profile.name} has {', '.join(profile.robot_ids)}"
        )
    robot = profile.robot(name)
    dfpcs = [dfpc.name for dfpc in robot.dfpcs]
    if mission.tracker not in dfpcs:
        raise ConfigurationError(f"tracker {mission.tracker!r}: {name} has {', '.join(dfpcs)}")
    processes = {dfpc.process or dfpc.name for dfpc in robot.dfpcs}
    for task in mission.tasks:
        if isinstance(task, RestartProcess) and task.process not in processes:
            raise ConfigurationError(f"process {task.process!r}: {name} has {', '.join(sorted(processes))}")
        if isinstance(task, LoseSensor) and task.sensor not in robot.sensors:
            raise ConfigurationError(f"sensor {task.sensor!r}: {name} has {', '.join(robot.sensors)}")
